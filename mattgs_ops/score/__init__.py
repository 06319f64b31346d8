"""Renders → metrics.

``metrics`` is the table of metrics and the image metrics themselves; ``evaluate`` renders the views
of trained splats and scores them, ``speed`` measures how fast they render.
"""
