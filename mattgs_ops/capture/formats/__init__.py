"""Readers of what comes with photos: cameras, splits and points.

``nerfstudio`` reads ``transforms.json`` and NeRF's layout, ``colmap`` a COLMAP project
(``colmap_model``, ``colmap_cameras``), ``split_lists`` lists of held-out photos, ``point_cloud``
sparse points. All return what ``posed`` defines. Public face: ``nerfstudio.read_nerfstudio``,
``colmap.read_colmap``, ``colmap_model.read_model`` and ``write_model``.
"""
