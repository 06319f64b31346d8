"""Readers of what comes with photos: cameras, splits and points.

``nerfstudio`` reads ``transforms.json`` and NeRF's layout, ``colmap`` a COLMAP project
(``colmap_model``, ``colmap_cameras``), ``split_lists`` lists of held-out photos, ``point_cloud``
sparse points, ``exif`` what a photo tells of its camera. What reads cameras returns what ``posed``
defines. Public face: ``nerfstudio.read_nerfstudio``, ``colmap.read_colmap``,
``colmap_model.read_model`` and ``write_model``, ``exif.exif_focal`` and ``exif_lens``.
"""
