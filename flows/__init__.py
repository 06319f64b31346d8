"""The flows: they wire tasks into benchmarks, gates and schedules.

``benchmark`` (captures × conditions × seeds on Dask), ``gate`` and ``gate_self_check`` (compare
with a baseline), ``scheduled`` (nightly grids), ``clean``. ``cli/`` is the command line,
``services/`` the servers that a flow needs, ``results/`` what is made of recorded runs.
"""
