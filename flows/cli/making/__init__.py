"""Commands that make what benchmarks run on: captures, and the networks that cut objects out."""
