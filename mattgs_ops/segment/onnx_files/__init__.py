"""ONNX files of networks: written, opened, kept as optimised for this CPU, in eight bits.

What their inputs and outputs mean is said where they are used: ``network`` and ``outline``.
"""
