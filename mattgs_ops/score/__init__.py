"""Renders → metrics.

``metrics`` is the table of metrics and the image metrics themselves; ``evaluate`` renders the views
of trained splats, scores them and measures rendering speed.
"""
