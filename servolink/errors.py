"""Every error servolink raises.

ServolinkError
├─ TransportError (ConnectionError)   the byte pipe could not be opened, or was lost
│  ├─ TransportUnavailable            unknown scheme or missing library; the text names the package to install
│  │  ├─ InvalidAddress (ValueError)  the address is written wrongly; the text shows the correct form      local
│  │  └─ ProfileError (ValueError)    the profile of the board is damaged; the text names file and line
│  ├─ OpenError                       not found, busy, not permitted; the text says what to do
│  │  └─ SeveralBoards                no board was named, and several were found; the text lists them      local
│  └─ ConnectionLost                  the open connection was lost; every waiting call gets the first cause
├─ PacketError (ValueError)
│  ├─ EncodeError                     a value does not fit its field; nothing was sent                     local
│  │  └─ MotionRefused                a movement beyond its limits, or impossible to check; nothing moved  local
│  └─ DecodeError                     the bytes are not a packet; `data` keeps them                        remote
├─ RequestError                       a request failed; `request` keeps it
│  ├─ RequestRefused                  not sent, or cancelled: by a stop, a role, a stopped servo           local
│  ├─ NotFound                        the board has no such servo, action, macro or table                  local
│  ├─ AmbiguousName                   several things on the board have this caption; the text lists them   local
│  ├─ RequestTimeout (TimeoutError)   no response in time; the request changed nothing on the board        remote
│  ├─ Rejected                        the board refused                                                    remote
│  ├─ WrongBoard                      a different board answers under this name; nothing was written       remote
│  └─ OutcomeUnknown                  sent without a response: the board may have obeyed or not            remote
├─ TargetNotReached                   servos have not arrived in time; the motion may still continue       remote
├─ ProjectError (ValueError)          a project, its file or a board's content is unusable; the text says where
├─ TwinError (ValueError)             a figure has no possible body, or MuJoCo is missing; the text says what to do
└─ RecordingError (ValueError)        a recording cannot be written or read; the text says what to do

Errors marked local are a LocalError as well, whose cause is on this side, and those marked remote a RemoteError, whose
cause is the board. The others come from between, or from files: the port, the network, a library.

Each is also the built-in error in brackets, so `except TimeoutError` and `except ConnectionError` work as usual.
"""

from __future__ import annotations

import errno
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from html import escape as escape_html
from typing import Any, Self


def install_extra(name: str) -> str:
    """Return how to install an extra, for the text of an error: servolink is on no package index."""
    return f"in a copy of servolink's repository: pip install '.[{name}]'"


class Reason(StrEnum):
    """Reason of an error, for programs; texts are for people and may change."""

    OTHER = "other"
    """None of the reasons below; the text says more."""
    LIMIT = "limit"
    """An angle is outside the limits of a servo, or a movement is too fast."""
    ANGLE_UNIT = "angle unit"
    """A servo is set to another angle unit, or a unit was set meanwhile."""
    SERVO_STATE = "servo state"
    """A servo is stopped or released, and would ignore the movement."""
    LEASE = "lease"
    """Another program moves the board."""
    EXCLUSIVE_USE = "exclusive use"
    """Another program has exclusive use of the board."""
    ROLE = "role"
    """The role of the program does not allow the request."""
    STOP = "stop"
    """A stop came first, or ended the motion."""
    STALL = "stall"
    """The guard of a hub stopped all servos, as one was stalled."""
    FORECAST = "forecast"
    """On its twin, the robot falls or hits itself, or nobody can say."""
    DEADLINE = "deadline"
    """The time by which the motion was to begin has passed."""
    NOT_FOUND = "not found"
    """No such device, port or host."""
    IN_USE = "in use"
    """Another program has the device, port or name."""
    NO_PERMISSION = "no permission"
    """The user may not open the device."""
    NO_RESPONSE = "no response"
    """The device is open, but no board answers."""
    SEVERAL_BOARDS = "several boards"
    """Two boards, or more, answer on one line."""

    @classmethod
    def _missing_(cls, value: object) -> Self:
        """Return `OTHER` for a reason of a newer hub."""
        return cls("other")


_REASONS: dict[object, Reason] = {
    **dict.fromkeys(
        (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ECONNREFUSED, errno.EHOSTUNREACH), Reason.NOT_FOUND
    ),
    **dict.fromkeys((errno.EBUSY, errno.EAGAIN, errno.EADDRINUSE, errno.EEXIST), Reason.IN_USE),
    **dict.fromkeys((errno.EACCES, errno.EPERM), Reason.NO_PERMISSION),
    errno.ETIMEDOUT: Reason.NO_RESPONSE,
}
"""Reasons by the number of the system's error."""


class ServolinkError(Exception):
    """Base class: `except ServolinkError` catches every error raised by servolink on purpose."""

    _reason = Reason.OTHER

    def __init__(self, *args: object, reason: Reason = Reason.OTHER) -> None:
        super().__init__(*args)
        if reason is not Reason.OTHER:
            self._reason = reason

    @property
    def reason(self) -> Reason:
        """Reason of the error, for programs: the reason given, or that of the cause."""
        cause = self.__cause__
        if self._reason is not Reason.OTHER or cause is None:
            return self._reason
        if isinstance(cause, ServolinkError):
            return cause.reason
        return _REASONS.get(getattr(cause, "errno", None), Reason.OTHER)

    def __str__(self) -> str:
        """Return the text with control and bidi characters escaped; `args` keeps the original text.

        Texts quote what boards, files and addresses contain, and every error can reach a terminal or a log.
        """
        return escape(super().__str__())

    def __repr__(self) -> str:
        """Return class and text, escaped: Python leaves some invisible characters unchanged."""
        return escape(super().__repr__())


class LocalError(ServolinkError):
    """Cause on this side: a wrong call, a limit, a stop, another program. The board is not to blame."""


class RemoteError(ServolinkError):
    """Cause on the side of the board: no response, a refusal, damaged bytes, a servo that does not arrive."""


class TransportError(ServolinkError, ConnectionError):
    """The byte pipe to the board failed."""


class TransportUnavailable(TransportError):
    """The address cannot be used here: a library is missing or a plug-in is broken."""


class InvalidAddress(TransportUnavailable, LocalError, ValueError):
    """The address is written wrongly: unknown scheme, option or name; the text shows the correct form."""


class ProfileError(TransportUnavailable, ValueError):
    """The profile of a board cannot be read or written; the text names the file and the line."""


class OpenError(TransportError):
    """The address could not be opened; the text gives the remedy."""


class SeveralBoards(OpenError, LocalError):
    """No board was named, and several were found; the text lists their addresses."""


class ConnectionLost(TransportError):
    """The open connection was lost; `__cause__` is the first error."""

    def copy(self) -> Self:
        """Return a copy, for a traceback of its own in each waiting task."""
        twin = type(self)(*self.args)
        twin.__cause__ = self.__cause__
        return twin


class PacketError(ServolinkError, ValueError):
    """A packet cannot be encoded or decoded."""


class EncodeError(PacketError, LocalError):
    """A value does not fit its field; the text names packet, field, value and range."""

    def __init__(self, text: str, path: str = "", packet: str = "", *, reason: Reason = Reason.OTHER) -> None:
        """Store `text`, escaped, and where the value is: `path` inside the packet, such as `steps[7].degree`."""
        where = ".".join(filter(None, (packet, path)))
        super().__init__(f"{where}: {text}" if where else text, reason=reason)
        self.text = escape(text)
        self.path = escape(path)
        self.packet = packet


class MotionRefused(EncodeError):
    """The movement exceeds angle limits or speed caps, or cannot be compared with the limits; nothing was sent."""


class DecodeError(PacketError, RemoteError):
    """The bytes are not a packet; `data` keeps them."""

    def __init__(self, text: str, data: bytes = b"", *, reason: Reason = Reason.OTHER) -> None:
        """Store `data`, the undecodable frame or content."""
        super().__init__(text, reason=reason)
        self.data = data


class RequestError(ServolinkError):
    """A request failed; `request` is the packet."""

    def __init__(self, text: str, request: Any = None, *, reason: Reason = Reason.OTHER) -> None:
        super().__init__(text, reason=reason)
        self.request = request


class RequestRefused(RequestError, LocalError):
    """The request was not sent, or was cancelled; `reason` says why, such as a stop or the role of the program."""


class ServoStalled(RequestRefused):
    """A motion was ended by the guard of a hub: a servo stood still far behind its course; the text has the numbers."""


class RequestTimeout(RequestError, RemoteError, TimeoutError):
    """No response in time; the request changed nothing on the board."""


class Rejected(RequestError, RemoteError):
    """The board refused the request."""


class NotFound(RequestError, LocalError):
    """The board has no servo, action, macro or table with the given id or caption."""


class AmbiguousName(RequestError, LocalError):
    """Several things on the board have the caption given in place of an id; the text lists their ids."""


class WrongBoard(RequestError, RemoteError):
    """A different board was learnt under the name of this board: nothing was moved or written."""


class OutcomeUnknown(RequestError, RemoteError):
    """The command was sent and no response came: read the state back before sending the command again."""


class TargetNotReached(RemoteError):
    """Servos have not arrived in time. The motion was sent and may still continue: check the robot before the next.

    Not a TimeoutError: programs that retry after a TimeoutError would repeat the motion.
    """

    def __init__(
        self, text: str, late: Mapping[int, tuple[int, int]] | None = None, *, reason: Reason = Reason.OTHER
    ) -> None:
        """Store `late`: actual and target position of each late servo, by id; empty if a hub did the waiting."""
        super().__init__(text, reason=reason)
        self.late = dict(late or {})


class ProjectError(ServolinkError, ValueError):
    """The project is unusable; the text names the place inside, such as `actions[3].steps[7].degree`."""


class TwinError(ServolinkError, ValueError):
    """The figure has no possible body, or MuJoCo is missing; the text gives the remedy."""


class RecordingError(ServolinkError, ValueError):
    """The recording cannot be written or read; the text gives the remedy."""


# --- text from outside, made safe to show ----------------------------------------------------------------------------

# Controls, format characters (bidi overrides), lone surrogates, private use, unassigned, and the two separators
# of lines: a terminal or a log obeys or misreads each of these characters.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
# Letters and marks without a visible shape, by which two different names can look alike.
_BLANKS = "\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0"
# Joiners, needed inside emoji and several scripts.
_JOINERS = "\u200c\u200d"

_LONGEST_QUOTE = 80
_SURROGATE = r"\udc"  # the beginning of an undecodable byte in the result of `repr`


def escape(text: str) -> str:
    """Return `text` with each control, bidi and undecodable character written as an escape.

    Escaping twice is the same as escaping once.
    """
    if text.isprintable() and text.isascii():
        return text
    return "".join(map(_escape_character, text))


def quote(value: object) -> str:
    """Return `repr(value)`, escaped and at most 80 characters long."""
    try:
        text = escape(repr(value)[: 2 * _LONGEST_QUOTE])  # a megabyte would take a second to escape
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists nested too deeply
        return f"this {type(value).__name__}"
    if _SURROGATE in text:
        text = _with_bytes(text)
    return text if len(text) <= _LONGEST_QUOTE else text[: _LONGEST_QUOTE - 3] + "..."


def _with_bytes(text: str) -> str:
    """Return the result of `repr` with undecodable bytes as `escape` writes them."""
    return re.sub(r"(?<!\\)((?:\\\\)*)\\udc([89a-f][0-9a-f])", r"\1\\x\2", text)


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table in HTML. Cells may be hostile: their text is escaped, and hidden characters are shown."""

    def row(cells: Sequence[object], tag: str) -> str:
        return f"<tr>{''.join(f'<{tag}>{escape_html(escape(str(cell)))}</{tag}>' for cell in cells)}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    title = f"<caption>{escape_html(escape(caption))}</caption>" if caption else ""
    return f"<table>{title}{row(columns, 'th')}{body}</table>"


def _escape_character(character: str) -> str:
    hidden = character in _BLANKS or unicodedata.category(character) in _HIDDEN
    if not hidden or character in _JOINERS:
        return character
    code = ord(character)
    if 0xDC00 <= code <= 0xDCFF:  # an undecodable byte (see protocol/caption.py)
        return f"\\x{code - 0xDC00:02x}"
    return f"\\x{code:02x}" if code <= 0xFF else f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
