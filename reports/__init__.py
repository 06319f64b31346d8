"""Rows in, tables, figures, pages and verdicts out; never touches the pipeline.

``rows/`` → ``tables/`` → ``figures/`` → ``page/``; ``gate/`` compares rows with a baseline.
``results/`` holds committed rows and reports.
"""
