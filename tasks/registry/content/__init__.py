"""What one MLflow run holds: everything that the interface shows of an experiment.

``values`` are metrics, parameters and tags; ``dataset`` the run's input, ``origin`` its source and
commit, ``description`` its text in Markdown, ``machine_load`` its system metrics; ``about`` is what
callers know of a run beside its row; ``owner`` is the process that works on it.
"""
