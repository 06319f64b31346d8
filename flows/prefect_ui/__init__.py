"""What Prefect's interface shows of a benchmark, and the messages that are sent from it.

``artifacts`` are progress, tables and links; ``notifications`` are sent when a run fails.
"""
