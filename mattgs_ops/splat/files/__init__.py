"""Splats on disk: ``ply`` (the original release's layout), and the formats of viewers.

``ply_arrays`` reads the former without torch. ``export`` is one entry for all of them;
``compressed_ply``, ``splat_file`` and ``spz_file`` write one format each, from the activated values
of ``activated``.
"""
