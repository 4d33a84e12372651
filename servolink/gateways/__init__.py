"""Gateways to programs of other kinds: language models and Foxglove, each as one more program of a hub."""
