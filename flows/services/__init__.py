"""Servers that flows and people need, started and stopped as a whole.

``embedded`` starts Prefect, Dask and MLflow where none are configured, ``background`` what takes
long; ``prefect_server`` is the Prefect server's process; ``serve`` runs schedules; ``mlflow_ui``
opens MLflow's page.
"""
