"""Byte pipes to a board: one interface, one file per kind."""
