"""The gate: candidate rows and baseline rows in, verdicts and an exit code out.

``compare`` decides from ``numbers``, ``tolerances`` and ``speed``; ``findings`` are its verdicts,
``output`` prints them; ``baseline`` keeps rows to compare with; ``self_check`` tries the gate
itself.
"""
