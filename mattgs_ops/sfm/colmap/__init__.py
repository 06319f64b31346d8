"""COLMAP (pycolmap) in a process of its own: key points, matches, mapping.

``process`` starts the worker and reads its answer, ``worker`` is the process, ``job`` what passes
between them; ``attempts`` runs ``features``, ``matching``, ``guided_matching``, ``mapping`` and
``lenses``.
Only the worker imports pycolmap: it clashes with other libraries in one process.
"""
