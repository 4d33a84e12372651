"""NestedFrameFilter: tells frames inside another frame, such as in a caption, from frames of the board."""

from __future__ import annotations

from servolink.protocol.frame import MAGIC, ByteOrder, Frame, encode_frame


class NestedFrameFilter:
    """Remembers the latest frame if others may begin inside it; the parser returns those right behind it, in order."""

    def __init__(self, byte_order: ByteOrder) -> None:
        """Remember nothing yet."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """The part of it that has not been returned as frames of its own; empty if nothing begins in it."""

    def hides(self, frame: Frame) -> bool:
        """Return whether `frame` begins inside the remembered one. If not, remember it instead."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return where in the remembered frame `data` begins, whole or up to the end of that frame."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None
