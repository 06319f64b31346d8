"""The MLflow registry; the only room that imports mlflow (with ``splat_model``).

``runs`` records rows, ``live_curves`` training curves, ``summary`` a benchmark as a whole,
``promotion`` baselines as models; ``lookup`` finds runs, ``orphans`` closes dead ones.
"""
