"""Pipes in memory, for tests of other rooms that run as in a page of a browser."""

from servolink.support.platforms.memory_pipes import MakeProtocol, connect_in_memory

__all__ = ["HAS_SOCKETS", "MakeProtocol", "connect_in_memory"]

HAS_SOCKETS = "servolink.support.platforms.memory_pipes._HAS_SOCKETS"
"""To be set to False."""
