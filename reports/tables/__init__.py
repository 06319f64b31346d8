"""Rows → tables: ``tables`` (I–III as the paper prints them), ``side_tables``, ``differences``.

``formats`` and ``latex`` write one table as text, Markdown, HTML, CSV or LaTeX; ``notes`` and
``origins`` say what a reader must know; ``paper`` reads the paper's values; ``verdict`` is the
first sentence.
"""
