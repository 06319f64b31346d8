"""Photos on disk → a prepared capture and a scene.

``source`` finds what a capture consists of (``formats``; ``video`` takes photos from a video);
``prepare`` validates, decodes and writes photos (``photos``), their masks (``mask_files``,
``masks``) and cameras; ``undistortion`` makes pinholes. ``scene``, ``sparse`` and ``camera`` hold
what later stages hand on. Public face: ``prepare.prepare``, ``source.open_source``,
``scene.Scene``.
"""
