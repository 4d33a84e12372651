"""The stage for a history: a program connected to a simulated board, with the checker in between."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from servolink.client import Board, Session
from servolink.connection import Connection, ConnectionOptions
from servolink.errors import DecodeError, OpenError
from servolink.motion import MotionLimits, MotionPlanner
from servolink.protocol import ClearAllDataRequest, Codec, Frame, Packet, Request
from servolink.transports import Transport, WrappedTransport
from tests.proofs.reliability.board import BOARDS, Character, SimulatedBoard, Wire
from tests.proofs.reliability.checker import CALL, Call, Checker
from tests.proofs.reliability.clock import Deadlock
from tests.proofs.reliability.conversation import LOADS, Conversation
from tests.proofs.reliability.line import LINES, Line
from tests.proofs.reliability.witness import WitnessedParser

_QUIET = 30.0
_REPLUGGED = 0.1
_MOST_OPENINGS = 30
_COUNTED = ("fences", "late_responses", "retries", "mismatched", "unsolicited", "reopenings")
_DEPTHS = (1, 1, 2, 4, 8, 16)


@dataclass(frozen=True, slots=True)
class Scene:
    """What a seed stands for."""

    seed: int
    line: Line
    board: Character
    callers: int = 1
    depth: int = 1
    load: str = "mixed"
    codec: Codec = Codec()  # noqa: RUF009 - nobody changes one

    @classmethod
    def of(cls, seed: int) -> Scene:
        """Go through all lines and boards in turn."""
        random = Random(f"scene {seed}")
        return cls(
            seed,
            LINES[seed % len(LINES)],
            BOARDS[seed // len(LINES) % len(BOARDS)],
            (depth := random.choice(_DEPTHS)) * random.choice((1, 1, 2)),
            depth,
            random.choice(tuple(LOADS)),
            Codec("big" if random.random() < 0.3 else "little"),
        )


class Cable(WrappedTransport):
    """Shows the checker what is sent and read, and damages what is sent."""

    def __init__(self, inner: Transport, board: SimulatedBoard, codec: Codec, wire: Wire, checker: Checker) -> None:
        """Lead to `board` through `inner`."""
        super().__init__(inner)
        self.link: Connection | None = None
        self._board, self._codec, self._wire, self._checker = board, codec, wire, checker

    async def send(self, data: bytes) -> None:
        """Send what the line leaves of a frame."""
        if not data:  # asks when all that was sent before has left
            await super().send(data)
            return
        assert self.link is not None  # nothing is sent before the connection is open
        packet = self._codec.decode_frame(data)
        opening = self.link.answers.opening
        opens = opening is not None and asyncio.current_task() is opening.task  # a handshake is in nobody's name
        number = self._checker.sends(packet, self._wire.now, self._deadline(packet), None if opens else CALL.get())
        self._checker.note(self._wire.now, "sent", data)
        if arriving := self._board.carry(packet.packet_id, data, number):
            await super().send(arriving)

    def data(self, chunk: bytes, /) -> None:
        """Pass on what has come."""
        self._checker.note(self._wire.now, "read", chunk)
        self._deliver(chunk)

    def _deadline(self, packet: Packet) -> float:
        assert self.link is not None  # nothing is sent before the connection is open
        if not isinstance(packet, Request) or self.link.answers.opening is not None:
            return 0.0
        slot = self.link.slots.lanes[packet.packet_id + 1].slots[-1]  # when it will be overdue
        return slot.sent_at + slot.timeout


class Stage:
    """Program, board and checker of one history."""

    def __init__(self, scene: Scene, wire: Wire, transport: Callable[[SimulatedBoard], Transport]) -> None:
        """`transport` makes each connection's way to the board."""
        random = Random(f"history {scene.seed}")
        self.checker = Checker(
            damaging=scene.line.damages, repeating=bool(scene.board.twice), ambiguous=scene.depth > 1
        )
        self.board = SimulatedBoard(scene.board, scene.line, scene.codec, random, wire, self.checker)
        self.conversation = Conversation(
            scene.line, LOADS[scene.load], random, self.checker, lambda: self.connected, self.reconnect
        )
        self.codec = scene.codec
        self.stats: Counter[str] = Counter()
        self._scene, self._wire, self._transport = scene, wire, transport
        self._reconnecting = asyncio.Lock()
        self._random = random

    async def connect(self) -> None:
        """Open a connection; the board may be down for a while, and the line may be bad."""
        for _ in range(_MOST_OPENINGS):
            try:
                await self.open_once()
            except OpenError:
                self.checker.counts["not opened"] += 1
            else:
                return
        raise Deadlock(f"no connection after {_MOST_OPENINGS} openings")

    async def open_once(self) -> None:
        """Open a connection. Raise OpenError if the board is silent."""
        await self.begin_opening()
        try:
            await self.link.shake_hands()
        except OpenError:
            await self.link.close()
            raise

    async def begin_opening(self) -> None:
        """Open a connection, whose handshake is still to come."""
        scene = self._scene
        cable = Cable(self._transport(self.board), self.board, scene.codec, self._wire, self.checker)
        depth = scene.depth
        options = ConnectionOptions(byte_order=scene.codec.byte_order, depth=depth, write_depth=depth)
        link = Connection(cable, options, learn=False, random=self._random)
        cable.link = self.link = link
        parser = WitnessedParser(scene.codec.byte_order, self._believes)
        parser.skipped = link.stats.skipped
        # What the connection believes is to be compared with what was said.
        link.answers._parser = link.answers.watchdog._parser = parser
        await link.open()
        self.connected = Board(Session(link), None, MotionPlanner(MotionLimits()))

    async def reconnect(self, lost: Board) -> None:
        """Replace a connection, unless that was done already."""
        async with self._reconnecting:
            if lost is self.connected:
                await self.disconnect()
                await asyncio.sleep(_REPLUGGED)
                await self.connect()

    async def disconnect(self) -> None:
        """Close the connection."""
        for name in _COUNTED:
            self.stats[name] += getattr(self.connected.stats, name)
        await self.connected.close()

    async def come_to_rest(self) -> None:
        """Do what needs all turns of the link for itself once all is over, which shows that no turn is kept."""
        self.board.heal()
        await asyncio.sleep(_QUIET)
        for _ in range(2):  # the first may find that the connection was given up, and replace it
            call = Call(self.conversation.steps, ClearAllDataRequest())
            right = self.checker.counts["right"]
            await self.conversation.do(call)
            if self.checker.counts["right"] > right:
                return
        self.checker.fault(self.conversation.steps, "the connection does not come to rest")

    def _believes(self, frame: Frame) -> None:
        if self.board.to_host.recognise(frame) is None:
            try:
                packet: Packet | None = self._scene.codec.decode(*frame)
            except DecodeError:
                packet = None
            self.checker.false_frame(packet)
