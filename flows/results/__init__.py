"""What is made of recorded runs: reports, exported splats, promoted models.

``rebuild`` makes a report from the registry, ``compile_report`` from files of rows; ``export``
writes splats in a viewer's format, ``promote`` makes a run the baseline of its cell,
``view`` shows its splats in the browser (``splats_of`` finds them), ``compare`` sets two runs side
by side.
"""
