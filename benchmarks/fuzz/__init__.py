"""Random and mutated bytes into everything that takes bytes: `python -m benchmarks.fuzz --minutes M`."""
