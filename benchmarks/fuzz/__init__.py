"""Random and mutated input for everything that takes bytes: `python -m benchmarks.fuzz --minutes M`."""
