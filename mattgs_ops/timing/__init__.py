"""How long work takes on a machine that others use too.

``stopwatch`` is a clock of CPU and wall time; ``calibration`` times a fixed workload, so that
speeds of two machines can be compared; ``machine_load`` samples CPU and
memory. Knows nothing of what is measured.
"""
