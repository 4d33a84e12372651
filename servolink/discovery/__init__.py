"""Which boards are here, and which of them is meant."""
