"""Rows: their ``schema`` and validator, and what is worked out of many of them.

``groups`` and ``columns`` name lines and numbers, ``comparable`` says whether two rows compare,
``merge`` joins sittings, ``statistics`` gives intervals.
"""
