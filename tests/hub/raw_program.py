"""A program without the library: it sends frames to a hub and takes what comes, as programs in other languages do."""

from __future__ import annotations

import asyncio

from servolink.control import Role
from servolink.hub.hub import Hub
from servolink.motion import AngleUnit
from servolink.protocol import Codec, FrameParser, Packet


class RawProgram:
    """One session with a hub."""

    def __init__(
        self,
        hub: Hub,
        who: str = "a raw program",
        *,
        role: Role = Role.EDIT,
        unit: AngleUnit = "degree",
        codec: Codec | None = None,
    ) -> None:
        self.codec = codec or Codec()
        self.heard: list[Packet] = []
        """All that came, button events too."""
        self._parser = FrameParser(self.codec.byte_order)
        self._came = asyncio.Event()
        self.session = hub.join(self._take, who=who, door="test", role=role, codec=self.codec, unit=unit)

    def send(self, packet: Packet) -> None:
        """Send a packet, and wait for nothing."""
        self.session.receive(self.codec.encode(packet, unchecked=True))

    async def ask(self, packet: Packet, seconds: float = 20.0) -> Packet | None:
        """Send a packet and return the response to it, None if there is none within `seconds`."""
        before = len(self.heard)
        self.send(packet)
        try:
            async with asyncio.timeout(seconds):
                while True:
                    for response in self.heard[before:]:
                        if response.packet_id == packet.packet_id + 1:
                            return response
                    self._came.clear()
                    await self._came.wait()
        except TimeoutError:
            return None

    def _take(self, data: bytes) -> None:
        for packet_id, content in self._parser.feed(data):
            self.heard.append(self.codec.decode(packet_id, content))
        self._came.set()
