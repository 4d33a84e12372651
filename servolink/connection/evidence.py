"""Evidence: what the bytes of a line say about the device at its other end, when no connection could be opened."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from servolink.errors import OpenError, Reason
from servolink.escaping import quote
from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import HEADER, MAGIC, OVERHEAD, ByteOrder, checksum
from servolink.protocol.layout import layout
from servolink.protocol.packet import Response

_LEAST_TEXT = 8  # characters
_MOST_TEXT = 60
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
    """Number of such responses."""
    text: str = ""
    """Beginning of the text between frames; empty without text."""
    sent: int = 0
    answered: int = 0
    """Responses to queries of the opening or of earlier programs."""

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
                f"sends bytes, but no frame of this protocol ({effort}): try the other byte order "
                f"(byte_order={other}) or another baud rate; it may also be another device; `servolink doctor` finds "
                "out"
            )
        return (
            f"is open, but no board answers ({effort}): is it switched on, is this its port, is it a data cable? Else "
            f"try another baud rate or the other byte order (byte_order={other}); `servolink doctor` finds out"
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


class HandshakeFailed(OpenError):
    """The address is open, but the handshake with the board failed."""

    def __init__(self, text: str, evidence: LineEvidence) -> None:
        """Keep the evidence beside the text."""
        super().__init__(text, reason=Reason.NO_RESPONSE)
        self.evidence = evidence


def evidence_in(data: bytes, byte_order: ByteOrder, *, received: int, sent: int, answered: int) -> LineEvidence:
    """Return the findings in `data`, the first of `received` bytes, after `sent` queries with `answered` responses."""
    own = list(_frames(data, byte_order))
    other = list(_frames(data, "little" if byte_order == "big" else "big"))
    fitting = [packet_id for packet_id, _, _, fits in own if fits]
    responses = [packet_id for packet_id in fitting if issubclass(PACKETS[packet_id], Response)]
    longer = [packet_id for packet_id, _, _, fits in own if not fits]
    return LineEvidence(
        byte_order,
        received,
        frames=len(responses),
        echoes=len(fitting) - len(responses),
        other_frames=sum(fits and issubclass(PACKETS[packet_id], Response) for packet_id, _, _, fits in other),
        longer=longer[0] if longer else 0,
        longer_frames=len(longer),
        text=text_between(data, byte_order),
        sent=sent,
        answered=answered,
    )


def text_between(data: bytes, byte_order: ByteOrder) -> str:
    """Return the beginning of the readable text outside of frames; empty if there is hardly any."""
    rest, at = bytearray(), 0
    for _, start, end, _ in _frames(data, byte_order):
        rest += data[at:start]
        at = max(at, end)
    rest += data[at:]
    lines = rest.decode("utf-8", "replace").splitlines()
    readable = [line.strip() for line in lines if line.strip() and line.strip().isprintable() and "\ufffd" not in line]
    text = " / ".join(readable)
    return text[:_MOST_TEXT] if len(text) >= _LEAST_TEXT and 2 * sum(map(len, readable)) >= len(rest) else ""


def _frames(data: bytes, byte_order: ByteOrder) -> Iterator[tuple[int, int, int, bool]]:
    """Yield packet id, start and end of each frame with a known id and the right sum, and whether its length fits."""
    at = data.find(MAGIC)
    while 0 <= at <= len(data) - OVERHEAD:
        _, packet_id, length = HEADER[byte_order].unpack_from(data, at)
        end = at + length + OVERHEAD
        declared = PACKETS.get(packet_id)
        if declared is not None and end <= len(data) and checksum(data[at : end - 1]) == data[end - 1]:
            yield packet_id, at, end, layout(declared, byte_order).rule.admits(length)
            at = end - 1
        at = data.find(MAGIC, at + 1)
