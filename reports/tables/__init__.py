"""Rows → tables: ``tables`` (I–III as the paper prints them), ``side_tables``, ``differences``.

``formats`` writes one table as text, Markdown, LaTeX, HTML or CSV; ``notes`` and ``origins`` say
what a reader must know; ``paper`` reads the paper's values; ``verdict`` is the first sentence.
"""
