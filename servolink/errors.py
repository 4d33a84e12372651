"""Every error servolink raises.

ServolinkError
├─ TransportError (ConnectionError)   the byte pipe: could not be had, or was lost
│  ├─ TransportUnavailable            unknown scheme or missing library; says what to install
│  ├─ OpenError                       not found, busy, not permitted; says what to do
│  └─ ConnectionLost                  was open and is gone; the first cause reaches every waiter
├─ PacketError (ValueError)
│  ├─ EncodeError                     your value does not fit; nothing was sent
│  └─ DecodeError                     the bytes make no packet; the bytes are kept
├─ RequestError                       the board was asked; `request` is kept
│  ├─ RequestTimeout (TimeoutError)   no answer in time, and nothing was changed by asking
│  ├─ Rejected                        the board said no
│  ├─ NotFound                        the board has no such servo, action, macro or table
│  └─ OutcomeUnknown                  sent, but no answer: it may or may not have happened
└─ ProjectError (ValueError)          a project, its file, or a board's content; says where inside it

Each is also the built-in error that a reader expects, so `except TimeoutError` and
`except ConnectionError` work as usual.
"""

from __future__ import annotations

from typing import Any


class ServolinkError(Exception):
    """The root: `except ServolinkError` catches whatever this library raises."""


class TransportError(ServolinkError, ConnectionError):
    """The byte pipe to the board failed."""


class TransportUnavailable(TransportError):
    """This kind of address cannot be used here: unknown scheme, bad option or missing library."""


class OpenError(TransportError):
    """The address could not be opened; the text says what to do about it."""


class ConnectionLost(TransportError):
    """The open connection is gone; `__cause__` is what ended it first."""


class PacketError(ServolinkError, ValueError):
    """A packet and its bytes do not fit each other."""


class EncodeError(PacketError):
    """A value does not fit its field; the text names packet, field, value and range."""


class DecodeError(PacketError):
    """Bytes that make no packet; `data` keeps them."""

    def __init__(self, message: str, data: bytes = b"") -> None:
        """Keep `data`, the frame or content that could not be decoded."""
        super().__init__(message)
        self.data = data


class RequestError(ServolinkError):
    """A request did not get the answer it asked for; `request` is the packet."""

    def __init__(self, message: str, request: Any = None) -> None:
        """Keep `request`, the packet that was asked."""
        super().__init__(message)
        self.request = request


class RequestTimeout(RequestError, TimeoutError):
    """No answer in time; the request changed nothing on the board."""


class Rejected(RequestError):
    """The board answered that it did not do it."""


class NotFound(RequestError):
    """The board has nothing under this id."""


class OutcomeUnknown(RequestError):
    """The command was sent and no answer came: read back before sending it again."""


class ProjectError(ServolinkError, ValueError):
    """A project cannot be used as it is; the text says where inside it, such as `actions[3].steps[7].degree`."""
