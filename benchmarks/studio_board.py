"""The board of the benchmark of the studio: a virtual one that prints when it was moved and stopped.

`python -m benchmarks.studio_board` prints its address, then a line of JSON for each such request: the clock, and the
targets by servo, none for a stop. It serves until its input ends.
"""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import AsyncExitStack
from time import perf_counter

from servolink.protocol.codec import Codec
from servolink.protocol.frame import MAGIC
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import ExecuteActionRequest, SetServoParameterRequest
from servolink.transports.listeners.forwarding import serve_network
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import BoardDriver, VirtualTransport

SERVOS = 16


class _WatchedTransport(VirtualTransport):
    """A line to the board on which movements and stops are seen."""

    def __init__(self, board: VirtualBoard) -> None:
        super().__init__(board)
        self._watching, self._codec = FrameParser(), Codec()

    def _send(self, data: bytes) -> None:
        now = perf_counter()
        for packet_id, content in self._watching.feed(data):
            if packet_id not in {ExecuteActionRequest.packet_id, SetServoParameterRequest.packet_id}:
                continue
            packet = self._codec.decode(packet_id, content)
            if isinstance(packet, ExecuteActionRequest):
                _print([now, {step.servo_id: step.degree for step in packet.steps}])
            elif isinstance(packet, SetServoParameterRequest) and not packet.is_start:
                _print([now, {}])
        super()._send(data)


def _print(line: object) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


async def _serve() -> None:
    board = VirtualBoard(servos=SERVOS)
    async with AsyncExitStack() as stack:
        stack.callback(BoardDriver(board).stop)
        listening = serve_network(lambda: _WatchedTransport(board), "127.0.0.1", 0, begins_with=MAGIC)
        _print(await stack.enter_async_context(listening))
        await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(_serve())
