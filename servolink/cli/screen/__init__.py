"""Modules that draw on the terminal and read keys."""
