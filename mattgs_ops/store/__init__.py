"""Finished stages, addressed by what went into them, and where a number comes from.

``store`` keeps artifacts in a folder (``lock``, ``cleaning``), ``remote`` on an object store;
``keys``, ``digests`` and ``code_version`` make keys; ``provenance`` names code, libraries and
machine.
"""
