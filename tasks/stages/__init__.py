"""How a stage runs: looked up in the store, else done in a process of its own, then kept.

``stage`` does that, ``process`` is the child process, ``status`` says what each stage is doing,
``quiet`` waits until nothing else runs here, ``travelling`` keeps checkpoints on a shared store.
"""
