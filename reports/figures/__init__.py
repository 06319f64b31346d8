"""Rows → figures: ``plots`` of numbers, ``photos`` of renders, ``attention``, ``trade_off``.

``all_figures`` draws those of a report. ``pictures`` finds stored renders, ``picture_grid`` places
them, ``findings`` writes captions.
"""
