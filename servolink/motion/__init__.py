"""Checks and computations before a movement is sent."""
