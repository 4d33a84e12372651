"""Every error servolink raises.

ServolinkError
├─ TransportError (ConnectionError)   the byte pipe could not be opened, or was lost
│  ├─ TransportUnavailable            unknown scheme or missing library; the text names the package to install
│  │  ├─ InvalidAddress (ValueError)  the address is written wrongly; the text shows the correct form
│  │  └─ ProfileError (ValueError)    the profile of the board is damaged; the text names file and line
│  ├─ OpenError                       not found, busy, not permitted; the text says what to do
│  │  └─ SeveralBoards                no board was named, and several were found; the text lists them
│  └─ ConnectionLost                  the open connection was lost; every waiting call gets the first cause
├─ PacketError (ValueError)
│  ├─ EncodeError                     a value does not fit its field; nothing was sent
│  │  └─ MotionRefused                a movement beyond its limits, or impossible to check; nothing moved
│  └─ DecodeError                     the bytes are not a packet; `data` keeps them
├─ RequestError                       a request failed; `request` keeps it
│  ├─ RequestTimeout (TimeoutError)   no response in time; the request changed nothing on the board
│  ├─ Rejected                        the board refused
│  ├─ NotFound                        the board has no such servo, action, macro or table
│  ├─ AmbiguousName                   several things on the board have this caption; the text lists them
│  ├─ WrongBoard                      a different board answers under this name; nothing was moved or written
│  └─ OutcomeUnknown                  sent without a response: the board may have obeyed or not
├─ TargetNotReached                   servos have not arrived in time; the motion was sent, and may still continue
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
    """Base class: `except ServolinkError` catches every error raised by servolink on purpose."""

    def __str__(self) -> str:
        """Return the text with control and bidi characters escaped; `args` keeps the original text.

        Texts quote what boards, files and addresses contain, and every error can reach a terminal or a log.
        """
        return escape(super().__str__())

    def __repr__(self) -> str:
        """Return class and text, escaped: Python leaves some invisible characters unchanged."""
        return escape(super().__repr__())


class TransportError(ServolinkError, ConnectionError):
    """The byte pipe to the board failed."""


class TransportUnavailable(TransportError):
    """The address cannot be used here: a library is missing or a plug-in is broken."""


class InvalidAddress(TransportUnavailable, ValueError):
    """The address is written wrongly: unknown scheme, option or name; the text shows the correct form."""


class ProfileError(TransportUnavailable, ValueError):
    """The profile of a board cannot be read or written; the text names the file and the line."""


class OpenError(TransportError):
    """The address could not be opened; the text gives the remedy."""


class SeveralBoards(OpenError):
    """No board was named, and several were found; the text lists their addresses."""


class ConnectionLost(TransportError):
    """The open connection was lost; `__cause__` is the first error."""


class PacketError(ServolinkError, ValueError):
    """A packet cannot be encoded or decoded."""


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
    """The movement exceeds angle limits or speed caps, or cannot be compared with the limits; nothing was sent."""


class DecodeError(PacketError):
    """The bytes are not a packet; `data` keeps them."""

    def __init__(self, text: str, data: bytes = b"") -> None:
        """Store `data`, the undecodable frame or content."""
        super().__init__(text)
        self.data = data


class RequestError(ServolinkError):
    """A request failed; `request` is the packet."""

    def __init__(self, text: str, request: Any = None) -> None:
        super().__init__(text)
        self.request = request


class RequestTimeout(RequestError, TimeoutError):
    """No response in time; the request changed nothing on the board."""


class Rejected(RequestError):
    """The board refused the request."""


class NotFound(RequestError):
    """The board has no servo, action, macro or table with the given id or caption."""


class AmbiguousName(RequestError):
    """Several things on the board have the caption given in place of an id; the text lists their ids."""


class WrongBoard(RequestError):
    """A different board was learnt under the name of this board: nothing was moved or written."""


class OutcomeUnknown(RequestError):
    """The command was sent and no response came: read the state back before sending the command again."""


class TargetNotReached(ServolinkError):
    """Servos have not arrived in time. The motion was sent and may still continue: check the robot before the next.

    Not a TimeoutError: programs that retry after a TimeoutError would repeat the motion.
    """

    def __init__(self, text: str, late: Mapping[int, tuple[int, int]] | None = None) -> None:
        """Store `late`: actual and target position of each late servo, by id; empty if a hub did the waiting."""
        super().__init__(text)
        self.late = dict(late or {})


class ProjectError(ServolinkError, ValueError):
    """The project is unusable; the text names the place inside, such as `actions[3].steps[7].degree`."""


class RecordingError(ServolinkError, ValueError):
    """The recording cannot be written or read; the text gives the remedy."""
