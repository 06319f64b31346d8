"""Plain numerics and files of MATT-GS Bench; never imports prefect, dask or mlflow."""
