"""Rows → figures: ``plots`` of numbers, ``photos`` of renders, ``attention``, ``trade_off``.

``pictures`` finds stored renders, ``picture_grid`` places them, ``findings`` writes captions.
"""
