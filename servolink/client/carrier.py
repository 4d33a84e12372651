"""Frames inside frames: a caption or test data may hold a whole frame, which must not pass for one that was said.

Beside damage, the parser returns the frames that it finds inside one that it has returned already, since a damaged
frame may have swallowed good ones (docs/design/parser.md). Nothing tells those from bytes that only look so. Here they
are dropped: what was really swallowed is asked for again, what was hidden must not be believed.
"""

from __future__ import annotations

from servolink.protocol.frame import MAGIC, ByteOrder, Frame, encode_frame


class Carrier:
    """The latest frame, if others may begin inside it; they come right behind it, in their order."""

    def __init__(self, byte_order: ByteOrder) -> None:
        """Remember nothing yet."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """What of it has not come out; empty if nothing begins in it."""

    def hides(self, frame: Frame) -> bool:
        """Tell whether `frame` begins inside the one before it; if not, it is the one before the next."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return where in the carrier `data` begins, whole or up to the carrier's end."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None
