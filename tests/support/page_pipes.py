"""Pipes in memory, for tests of other rooms that run as in a page of a browser."""

from servolink.support.platforms.memory_pipes import MakeProtocol, connect_in_memory

__all__ = ["CONNECT", "HAS_SOCKETS", "IS_SAME_USER", "MakeProtocol", "connect_in_memory"]

HAS_SOCKETS = "servolink.support.platforms.memory_pipes._HAS_SOCKETS"
"""To be False."""
CONNECT = "servolink.control.share_address.connect_locally"
"""To be a coroutine function that connects in memory."""
IS_SAME_USER = "servolink.hub.doors.socket_door.is_same_user"
"""To return True: a pipe in memory has no socket."""
