"""Every error servolink raises.

ServolinkError
├─ TransportError (ConnectionError)   the byte pipe could not be opened, or was lost
│  ├─ TransportUnavailable            unknown scheme or missing library; the text says what to install
│  │  ├─ InvalidAddress (ValueError)  the address is written wrongly; the text says how to write it
│  │  └─ ProfileError (ValueError)    what is kept of the board is damaged; the text says in which file and line
│  ├─ OpenError                       not found, busy, not permitted; the text says what to do
│  │  └─ SeveralBoards                none was named, and several are here; the text lists them
│  └─ ConnectionLost                  was open and is lost; every waiting call gets the first cause
├─ PacketError (ValueError)
│  ├─ EncodeError                     a value does not fit its field; nothing was sent
│  │  └─ MotionRefused                a movement beyond its limits, or one that cannot be checked; nothing moved
│  └─ DecodeError                     the bytes are not a packet; `data` keeps them
├─ RequestError                       a request failed; `request` keeps it
│  ├─ RequestTimeout (TimeoutError)   no response in time; the request changed nothing on the board
│  ├─ Rejected                        the board refused
│  ├─ NotFound                        the board has no such servo, action, macro or table
│  ├─ AmbiguousName                   several things on the board have this caption; the text lists them
│  ├─ WrongBoard                      another board than the one of that name; nothing was moved or written
│  └─ OutcomeUnknown                  sent without a response: the board may have obeyed or not
├─ TargetNotReached                   servos have not arrived in time; their motion was sent, and may still go on
├─ ProjectError (ValueError)          a project, its file or a board's content is unusable; the text says where
└─ RecordingError (ValueError)        a recording cannot be written or read; the text says what to do

Each is also the built-in error in brackets, so `except TimeoutError` and `except ConnectionError` work as usual.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from servolink.escaping import escape


def install_extra(name: str) -> str:
    """Return how to install an extra, for the text of an error: servolink is on no package index."""
    return f"in a copy of servolink's repository: pip install '.[{name}]'"


class ServolinkError(Exception):
    """The root: `except ServolinkError` catches every error this library raises on purpose."""

    def __str__(self) -> str:
        """Return the text with control and bidi characters escaped; `args` keeps it as it was.

        Texts quote what boards, files and addresses contain, and every error can reach a terminal or a log.
        """
        return escape(super().__str__())

    def __repr__(self) -> str:
        """Return class and text, escaped: Python leaves some invisible characters as they are."""
        return escape(super().__repr__())


class TransportError(ServolinkError, ConnectionError):
    """The byte pipe to the board failed."""


class TransportUnavailable(TransportError):
    """The address cannot be used here: a library is missing or a plug-in is broken."""


class InvalidAddress(TransportUnavailable, ValueError):
    """The address is written wrongly: unknown scheme, option or name; the text says how to write it."""


class ProfileError(TransportUnavailable, ValueError):
    """The profile of a board cannot be read or written; the text names the file and the line."""


class OpenError(TransportError):
    """The address could not be opened; the text says what to do about it."""


class SeveralBoards(OpenError):
    """No board was named, and several are here; the text lists them."""


class ConnectionLost(TransportError):
    """The open connection was lost; `__cause__` is the first error that ended it."""


class PacketError(ServolinkError, ValueError):
    """A packet and its bytes do not match."""


class EncodeError(PacketError):
    """A value does not fit its field; the text names packet, field, value and range."""

    def __init__(self, text: str, path: str = "", packet: str = "") -> None:
        """Store `text`, escaped, and where the value is: `path` inside the packet, such as `steps[7].degree`."""
        where = ".".join(filter(None, (packet, path)))
        super().__init__(f"{where}: {text}" if where else text)
        self.text = escape(text)
        self.path = escape(path)
        self.packet = packet


class MotionRefused(EncodeError):
    """A movement beyond angle limits or speed caps, or one that cannot be compared with them; it was not sent."""


class DecodeError(PacketError):
    """The bytes are not a packet; `data` keeps them."""

    def __init__(self, text: str, data: bytes = b"") -> None:
        """Store `data`, the frame or content that could not be decoded."""
        super().__init__(text)
        self.data = data


class RequestError(ServolinkError):
    """A request failed; `request` is the packet."""

    def __init__(self, text: str, request: Any = None) -> None:
        """Store `request`, the packet."""
        super().__init__(text)
        self.request = request


class RequestTimeout(RequestError, TimeoutError):
    """No response in time; the request changed nothing on the board."""


class Rejected(RequestError):
    """The board refused the request."""


class NotFound(RequestError):
    """The board has nothing with this id or caption."""


class AmbiguousName(RequestError):
    """Several things on the board have the caption that was given in place of an id; the text lists them."""


class WrongBoard(RequestError):
    """The board is not the one that was learnt under its name: nothing was moved or written."""


class OutcomeUnknown(RequestError):
    """The command was sent and no response came: read back before sending it again."""


class TargetNotReached(ServolinkError):
    """Servos have not arrived in time: the motion was sent and may still go on, so look at the robot before another.

    No TimeoutError: who asks again after one would repeat the motion.
    """

    def __init__(self, text: str, late: Mapping[int, tuple[int, int]] | None = None) -> None:
        """Store `late`: where each servo is and where it should be, by id; empty if a hub has waited for them."""
        super().__init__(text)
        self.late = dict(late or {})


class ProjectError(ServolinkError, ValueError):
    """A project cannot be used as it is; the text says where inside it, such as `actions[3].steps[7].degree`."""


class RecordingError(ServolinkError, ValueError):
    """A recording cannot be written or read; the text says what to do."""
