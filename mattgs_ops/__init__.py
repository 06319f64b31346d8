"""Plain numerics and files of MATT-GS Bench; never imports prefect, dask or mlflow.

Rooms in the order of the data: ``capture`` → ``segment`` → ``sfm`` → ``splat`` → ``object_masks`` →
``score``; ``store`` and ``timing`` serve them, ``synthetic`` renders the captures in ``bundled``.
At the top: ``config`` (a benchmark), ``method`` (what a method changes), ``naming`` (names from
outside that become paths), ``errors``.
"""
