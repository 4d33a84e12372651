"""Evidence: what the bytes of a line say about the device at its other end, when no connection could be opened."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from servolink.connection.line_marks import (
    LONG_PAUSE,
    LineBytes,
    Mark,
    frames_in,
    is_longer,
    marks_in,
    outside_frames,
    shown,
)
from servolink.errors import OpenError, Reason, quote
from servolink.protocol import PACKETS, ByteOrder, Response

_FIRST = 16  # bytes
_LEAST_TEXT = 8  # characters
_MOST_TEXT = 60
_MOST_KEPT = 8192  # bytes
_LEAST_SENT = 8  # queries
_LEAST_REPEATED = 8  # responses beyond the queries; fewer may have been owed to an earlier program


class LineEvidence(Struct, frozen=True):
    """Findings in the bytes received during an opening."""

    byte_order: ByteOrder
    received: int = 0
    """Number of bytes received in all."""
    frames: int = 0
    """Responses and events with the right sum, in the byte order of the connection."""
    echoes: int = 0
    """Requests with the right sum: the line returns what is sent."""
    other_frames: int = 0
    """Frames with the right sum in the other byte order."""
    longer: int = 0
    """Packet id of a response with the right sum and more content than in the document; 0 without one."""
    longer_frames: int = 0
    """Number of responses of this kind so far."""
    text: str = ""
    """Beginning of the text between frames; empty without text."""
    several: bool = False
    """Whether two boards, or more, answer."""
    sent: int = 0
    answered: int = 0
    """Responses to queries of the opening or of earlier programs."""
    data: bytes = b""
    """First bytes that came from the line."""
    pause: float = 0.0
    """Longest pause in seconds inside a frame."""

    is_held: bool = False
    """Whether each response comes only behind the next query."""

    @property
    def mark(self) -> Mark | None:
        """What the bytes show about firmware, bridge or line; None without such a mark."""
        return next(iter(marks_in(self.data, self.byte_order)), None)

    @property
    def other_order(self) -> ByteOrder:
        """The byte order that is not in use."""
        return "little" if self.byte_order == "big" else "big"

    @property
    def answers_twice(self) -> bool:
        """Whether more responses came than an earlier program can have left."""
        return self.sent >= _LEAST_SENT and self.answered - self.sent >= max(_LEAST_REPEATED, self.sent // 16)

    @property
    def has_longer_contents(self) -> bool:
        """Whether responses with more content than in the document are no accident of a bad line."""
        return self.longer_frames > max(1, self.frames)

    @property
    def is_board(self) -> bool:
        """Whether a frame of this protocol was received."""
        return bool(self.frames or self.other_frames or self.longer or self.answered)

    def explain_silence(self, effort: str) -> str:
        """Return why no response was found after `effort`, such as "6 queries in 3.0 s", and the remedy."""
        other = self.other_order
        if self.other_frames:
            return f"answers in {other} byte order ({effort}): use byte_order={other}"
        if self.longer:
            return self._explain_longer(effort)
        if (mark := self.mark) is not None:
            return f"{mark.text} ({effort}): {mark.meaning}; {mark.remedy}".replace("\n", "; ")
        if self.echoes:
            return (
                f"returns the requests that are sent to it, and no response ({effort}): the two data lines are "
                "connected with each other, or this is the wrong port"
            )
        if self.text:
            return (
                f"sends text, {quote(self.text)}, and no frame of this protocol ({effort}): wait until the board has "
                "started, and try again; it may also be another device"
            )
        if self.received:
            return (
                f"sends bytes, {shown(self.data[:_FIRST])}, but no frame of this protocol ({effort}): try the other "
                f"byte order (byte_order={other}) or another baud rate; it may also be another device; "
                "`servolink doctor` finds out"
            )
        return (
            f"is open, but no board answers ({effort}): is it switched on, is this its port, is it a data cable? Else "
            f"try another baud rate, other serial settings of the board (no parity, no flow control) or the other byte "
            f"order (byte_order={other}); `servolink doctor` finds out"
        )

    def explain_too_little(self, effort: str) -> str:
        """Return why a board that answers could not be opened after `effort`, and the remedy."""
        if self.longer:
            return self._explain_longer(effort)
        if self.answers_twice:
            return (
                f"answers requests more than once ({self.answered} responses to {effort}): use answers_twice=yes, "
                "which tells first and second responses apart"
            )
        if self.pause:
            return (
                f"sends each response in parts, with a pause of {self.pause:.1f} s inside a frame ({effort}): a "
                "bridge, adapter or the firmware holds bytes back; set it to send at once what it receives"
            )
        if self.is_held:
            return (
                f"answers each query only when the next one is sent ({effort}): an adapter, a bridge or the firmware "
                "holds each response back; set it to send at once what it receives"
            )
        if not self.answered:
            return (
                f"answers the transmission mode setting or sends button events, but answers none of the short queries "
                f"({effort}): switch it off and on, and try again"
            )
        return (
            f"answers, but too little to be sure whose responses they are ({effort}): the line is bad, or the board is "
            "busy; try again, or run `servolink doctor`"
        )

    def _explain_longer(self, effort: str) -> str:
        return (
            f"sends frames of this protocol with more content than the document says, such as packet {self.longer} "
            f"({effort}): use ignore_extra=yes"
        )


class ReceivedBytes:
    """Bytes received during an opening: the first ones, and their number."""

    def __init__(self) -> None:
        """Start without bytes or responses."""
        self._first = bytearray()
        self._count = 0
        self._heard_at = self._pause = 0.0  # loop time of the latest bytes; longest pause inside a frame

    def add(self, chunk: bytes, now: float) -> None:
        """Count a chunk received `now`, and keep what there is room for."""
        pause, self._heard_at = now - self._heard_at, now
        if self._first and pause > max(self._pause, LONG_PAUSE) and LineBytes(bytes(self._first)).ends_inside():
            self._pause = pause
        self._count += len(chunk)
        self._first += chunk[: _MOST_KEPT - len(self._first)]

    def evidence(self, byte_order: ByteOrder, *, sent: int, answered: int, is_held: bool) -> LineEvidence:
        """Return the findings, after `sent` queries with `answered` responses."""
        found = evidence_in(
            bytes(self._first), byte_order, received=self._count, sent=sent, answered=answered, pause=self._pause
        )
        return replace(found, is_held=is_held)


class HandshakeFailed(OpenError):
    """The address is open, but the handshake with the board failed."""

    def __init__(self, text: str, evidence: LineEvidence, reason: Reason = Reason.NO_RESPONSE) -> None:
        """Keep the evidence beside the text."""
        super().__init__(text, reason=reason)
        self.evidence = evidence


def evidence_in(
    data: bytes, byte_order: ByteOrder, *, received: int, sent: int, answered: int, pause: float = 0.0
) -> LineEvidence:
    """Return the findings in `data`, the first of `received` bytes, after `sent` queries with `answered` responses.

    `pause` is the longest pause inside a frame, in seconds.
    """
    own = list(frames_in(data, byte_order))
    other = list(frames_in(data, "little" if byte_order == "big" else "big"))
    fitting = [frame.packet_id for frame in own if frame.fits]
    responses = [packet_id for packet_id in fitting if issubclass(PACKETS[packet_id], Response)]
    longer = [frame.packet_id for frame in own if is_longer(frame)]
    return LineEvidence(
        byte_order,
        received,
        frames=len(responses),
        echoes=len(fitting) - len(responses),
        other_frames=sum(frame.fits and issubclass(PACKETS[frame.packet_id], Response) for frame in other),
        longer=longer[0] if longer else 0,
        longer_frames=len(longer),
        text=text_between(data, byte_order),
        sent=sent,
        answered=answered,
        data=data,
        pause=pause,
    )


def text_between(data: bytes, byte_order: ByteOrder) -> str:
    """Return the beginning of the readable text outside of frames; empty if there is hardly any."""
    rest = b"".join(outside_frames(data, byte_order))
    lines = rest.decode("utf-8", "replace").splitlines()
    readable = [line.strip() for line in lines if line.strip() and line.strip().isprintable() and "\ufffd" not in line]
    text = " / ".join(readable)
    return text[:_MOST_TEXT] if len(text) >= _LEAST_TEXT and 2 * sum(map(len, readable)) >= len(rest) else ""
