"""Synthetic photos with exact masks, to train the segmenter on.

``composites`` paints objects (``things`` of flat ``solids``, smooth ``figures`` by
``figure_families``, ``organic`` ones) with ``draw`` and ``textures`` on cluttered desks,
``plain_grounds`` and on backdrops that ``traced`` renders with Mitsuba, as it does whole views.
"""
