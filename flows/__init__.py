"""Flows wire tasks together: the benchmark grid, its command line and its deployments."""
