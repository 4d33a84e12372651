"""Differences between operating systems: each module offers one service, implemented for every system."""
