"""One task per operation: cache key, retries, timeouts, logs.

A module per stage (``prepare``, ``segment``, ``sfm``, ``agree``, ``train``, ``evaluate``,
``measure``), and the ``row`` that an experiment yields. ``stages/`` runs a stage,
``registry/`` talks to MLflow.
"""
