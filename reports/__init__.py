"""Rows to tables, figures and verdicts; never touches the pipeline."""
