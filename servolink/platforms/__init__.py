"""Differences between operating systems: each module gives one thing, and contains the way of every system to it."""
