"""Photos on disk → a prepared capture and a scene.

``prepare`` validates and decodes photos (``photos``), their masks (``mask_files``, ``masks``) and
the cameras that come with them (``formats``); ``undistortion`` makes pinholes. ``scene``,
``sparse`` and ``camera`` hold what later stages hand on. Public face: ``prepare.prepare``,
``scene.Scene``.
"""
