"""LenientParser: frames of boards whose responses have more content than the document says."""

from __future__ import annotations

from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import Frame
from servolink.protocol.layouts import layout
from servolink.protocol.packet import Response
from servolink.protocol.parser import FrameParser

_MOST_EXTRA = 255  # bytes: longer ones are taken for damaged lengths, which would hold back what follows


class LenientParser(FrameParser):
    """Parser that accepts longer responses, and drops what stands behind the content of the document."""

    def feed(self, chunk: bytes | bytearray | memoryview) -> list[Frame]:
        """Take the next bytes of the stream, and return the frames completed by them."""
        return [self._documented(frame) for frame in super().feed(chunk)]

    def abandon_frame(self) -> list[Frame]:
        """Stop waiting for the rest of the partial frame, and return the frames inside."""
        return [self._documented(frame) for frame in super().abandon_frame()]

    def _documented(self, frame: Frame) -> Frame:
        packet_id, content = frame
        return packet_id, layout(PACKETS[packet_id], self.byte_order).documented(content)

    def _admits(self, packet_id: int, length: int) -> bool:
        if super()._admits(packet_id, length):
            return True
        declared = PACKETS[packet_id]
        rule = layout(declared, self.byte_order).rule
        most = rule.base + rule.unit * rule.limit + _MOST_EXTRA
        return issubclass(declared, Response) and rule.base <= length <= most
