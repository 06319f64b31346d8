"""Synthetic photos with exact masks, to train the segmenter on.

``composites`` paints objects (``things``, ``solids``, ``organic``) over backdrops with ``draw`` and
``textures``; ``path_traced`` renders views with Mitsuba; ``backdrops`` reads its empty desks.
"""
