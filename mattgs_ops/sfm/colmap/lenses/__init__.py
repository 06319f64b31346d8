"""Lenses of photos: which of them share one, and where the axis meets photos that were cropped.

``build`` makes COLMAP's cameras and checks what became of them, ``cropped`` moves axes. Worker
process only.
"""
