"""Life of a connection: its states, and the event that leads from one to the next (docs/design/opening.md)."""

from __future__ import annotations

from enum import Enum

from servolink.errors import ConnectionLost


class State(Enum):
    """State of a connection. A stop is sent in all states but the first and the last."""

    NEW = "new"
    """The transport is not open."""
    UNPROVED = "unproved"
    """Responses to earlier programs may still come; the first request begins the handshake."""
    OPENING = "opening"
    """The handshake is under way and gets all responses; requests wait."""
    READY = "ready"
    """Requests are sent, and responses arrive."""
    SUSPENDED = "suspended"
    """Another program has exclusive use of a shared board; requests wait, and nothing is late."""
    REOPENING = "reopening"
    """A stray response has shown that the handshake was wrong: the handshake is repeated."""
    ENDED = "ended"
    """The connection was lost or closed, for good; all waiting callers get the first cause."""


class ConnectionEvent(Enum):
    """Event in the life of a connection."""

    OPENED = "opened"
    """The transport is open; the handshake is still to come."""
    JOINED = "joined"
    """The transport is open and nothing is owed to others, as in a new session with a hub."""
    HANDSHAKE_BEGUN = "handshake begun"
    HANDSHAKE_DONE = "handshake done"
    HANDSHAKE_CANCELLED = "handshake cancelled"
    """The handshake ended without a result, but the transport is still open."""
    STRAY_RESPONSE = "stray response"
    """An unrequested response to a fence was received."""
    SUSPENDED = "suspended"
    RESUMED = "resumed"
    LOST = "lost"
    """The transport has ended, the board is silent, or the program has closed the connection."""


TRANSITIONS: dict[State, dict[ConnectionEvent, State]] = {
    State.NEW: {
        ConnectionEvent.OPENED: State.UNPROVED,
        ConnectionEvent.JOINED: State.READY,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.UNPROVED: {
        ConnectionEvent.HANDSHAKE_BEGUN: State.OPENING,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.OPENING: {
        ConnectionEvent.HANDSHAKE_DONE: State.READY,
        ConnectionEvent.HANDSHAKE_CANCELLED: State.UNPROVED,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.READY: {
        ConnectionEvent.STRAY_RESPONSE: State.REOPENING,
        ConnectionEvent.SUSPENDED: State.SUSPENDED,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.SUSPENDED: {
        ConnectionEvent.SUSPENDED: State.SUSPENDED,
        ConnectionEvent.RESUMED: State.READY,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.REOPENING: {
        ConnectionEvent.HANDSHAKE_DONE: State.READY,
        ConnectionEvent.HANDSHAKE_CANCELLED: State.UNPROVED,
        ConnectionEvent.LOST: State.ENDED,
    },
    State.ENDED: {
        ConnectionEvent.OPENED: State.ENDED,
        ConnectionEvent.JOINED: State.ENDED,
        ConnectionEvent.HANDSHAKE_CANCELLED: State.ENDED,
        ConnectionEvent.SUSPENDED: State.ENDED,
        ConnectionEvent.LOST: State.ENDED,
    },
}
"""Next state by state and event; an event that is missing cannot happen in that state."""


class Lifecycle:
    """State of one connection with its facts, shared by the sending and the receiving half."""

    def __init__(self, *, outlasts_silence: bool = False) -> None:
        """Start before the transport is open. With `outlasts_silence` a silent board does not end the connection."""
        self.state = State.NEW
        self.ended: ConnectionLost | None = None
        """First cause of the end; None before it."""
        self.outlasts_silence = outlasts_silence
        """Whether silence ends nothing: a hub goes on without its board, and closes the connection when it ends."""
        self.silent_because = ""
        """Known cause of a board that does not answer; empty if none is known."""
        self._suspended_because = ""

    def change(self, event: ConnectionEvent) -> None:
        """Enter the next state after `event`. Raise RuntimeError if the event cannot happen now."""
        following = TRANSITIONS[self.state].get(event)
        if following is None:
            raise RuntimeError(f"internal error: the event {event.value!r} on a connection that is {self.state.value}")
        self.state = following
        if following is not State.SUSPENDED:
            self._suspended_because = ""

    def suspend(self, reason: str) -> None:
        """Enter `suspended`; `reason` goes into the errors of callers whose time runs out."""
        self.change(ConnectionEvent.SUSPENDED)
        self._suspended_because = reason

    def end(self, error: ConnectionLost) -> bool:
        """Enter `ended` because of `error`. Return False if the connection had ended before."""
        self.change(ConnectionEvent.LOST)
        if self.ended is not None:
            return False
        self.ended = error
        return True

    @property
    def excuse(self) -> str:
        """Reason why the board cannot answer now; empty if none is known."""
        return self._suspended_because or self.silent_because
