"""Random and mutated input for everything that takes bytes: `python -m tests.proofs.fuzz --minutes M`."""
