"""Commands that make what benchmarks run on: captures, and the networks that cut objects out.

``captures`` and ``segment`` are a group of commands each; ``register`` adds it to the command line.
"""
