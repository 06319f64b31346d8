"""Renders → metrics.

``metrics`` is the table of metrics and the image metrics themselves, ``perceptual`` how different
images look, ``haze`` what hangs in the air before a camera; ``evaluate`` renders the views of
trained splats and scores them, ``speed`` measures how fast they render.
"""
