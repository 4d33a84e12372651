"""One seed, one history of a shared board: programs that come, ask and are killed, and a line that is bad or pulled."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import count
from random import Random

from servolink.client import Board, BoardIdentity, Session
from servolink.connection import Connection, ConnectionOptions, PacketConnection, ResponseDispatcher
from servolink.errors import DecodeError, OpenError
from servolink.hub import Hub, share
from servolink.motion import MotionLimits, MotionPlanner
from servolink.protocol import Codec, Frame, Packet
from servolink.transports import Receiver, WrappedTransport
from tests.proofs.reliability.board import BOARDS, Character, SimulatedBoard
from tests.proofs.reliability.clock import Deadlock, SimulatedLoop
from tests.proofs.reliability.history import DirectTransport
from tests.proofs.reliability.hub_checker import HubChecker, shared_board_response
from tests.proofs.reliability.hub_programs import KINDS, SharingProgram
from tests.proofs.reliability.line import LINES, Line
from tests.proofs.reliability.witness import WitnessedParser

STEPS = 2000
"""Requests in a history."""
PROGRAMS = (1, 8, 32)
"""How many programs share the board."""
_DEPTHS = (1, 1, 4, 16)
_MOST_OPENINGS = 30
_PULLED_EVERY = (0.5, 10.0)  # seconds between two times that the cable is pulled
_LIFE = (5, 200)  # requests of one program
_KILLED = 0.5  # chance that a program is killed in the middle of what it does
_CODEC = Codec()


@dataclass(frozen=True, slots=True)
class HubScene:
    """What a seed stands for."""

    seed: int
    line: Line
    board: Character
    programs: int
    depth: int
    pulled: bool

    @classmethod
    def of(cls, seed: int) -> HubScene:
        """Go through all numbers of programs, lines and boards in turn."""
        random = Random(f"hub scene {seed}")
        at, programs = divmod(seed, len(PROGRAMS))
        return cls(
            seed,
            LINES[at % len(LINES)],
            BOARDS[at // len(LINES) % len(BOARDS)],
            PROGRAMS[programs],
            random.choice(_DEPTHS),
            random.random() < 0.5,
        )


@dataclass(slots=True)
class HubHistory:
    """What happened."""

    scene: HubScene
    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0
    """Virtual ones."""
    latest: deque[tuple[float, str, str]] = field(default_factory=deque)
    """The last events before the first fault, or before the end."""


class _Cable(WrappedTransport):
    """Shows the judge what is sent and believed, damages what is sent, and can be pulled."""

    def __init__(self, stage: _Stage) -> None:
        super().__init__(DirectTransport(stage.board, stage.loop))
        self._shown_to = stage

    async def open(self, receiver: Receiver) -> None:
        assert isinstance(receiver, ResponseDispatcher)
        parser = WitnessedParser(_CODEC.byte_order, self._shown_to.believes)
        parser.skipped = receiver._parser.skipped
        receiver._parser = parser  # what it believes is to be compared with what was said
        await super().open(receiver)

    async def send(self, data: bytes) -> None:
        if data:
            data = self._shown_to.carry(data)
        if data:
            await super().send(data)

    def pull(self) -> None:
        self._break("it was unplugged")


class _AnyBoard(BoardIdentity):
    """Recognises every board: the simulated one tells another project id each time."""

    async def check(self, connection: PacketConnection) -> None:
        """Find it to be the right one."""


class _Stage:
    """A hub with its board, and the judge between them."""

    def __init__(self, scene: HubScene, loop: SimulatedLoop) -> None:
        random = Random(f"hub history {scene.seed}")
        self.scene, self.loop, self.random = scene, loop, random
        self.checker = HubChecker(damaging=scene.line.damages, repeating=bool(scene.board.twice))
        self.board = SimulatedBoard(scene.board, scene.line, _CODEC, random, loop, self.checker, shared_board_response)
        self._cable: _Cable | None = None

    @asynccontextmanager
    async def shared(self) -> AsyncIterator[Hub]:
        """Share the board, and pull its cable now and then if the scene says so."""
        session = Session(await self._connected(), self._open)
        session.identity = _AnyBoard()
        board = Board(session, None, MotionPlanner(MotionLimits()))
        async with share(board, name="rex") as hub:
            pulling = self.loop.create_task(self._pull()) if self.scene.pulled else None
            try:
                yield hub
            finally:
                if pulling is not None:
                    pulling.cancel()
        await board.close()

    def carry(self, frame: bytes) -> bytes:
        """Return what arrives at the board of a frame of the hub."""
        packet = _CODEC.decode_frame(frame)
        self.checker.note(self.loop.now, "sent", str(packet))
        return self.board.carry(packet.packet_id, frame, self.checker.sends(packet))

    def believes(self, frame: Frame) -> None:
        """Compare a frame that the hub believes with those that were said."""
        try:
            packet: Packet | None = _CODEC.decode(*frame)
        except DecodeError:
            packet = None
        self.checker.note(self.loop.now, "heard", str(packet))
        if self.board.to_host.recognise(frame) is None:
            self.checker.false_frame(packet)

    async def _connected(self) -> Connection:
        for _ in range(_MOST_OPENINGS):
            try:
                return await self._open()
            except OpenError:
                self.checker.counts["not opened"] += 1
        raise Deadlock(f"no connection after {_MOST_OPENINGS} openings")

    async def _open(self) -> Connection:
        self._cable = cable = _Cable(self)
        connection = Connection(cable, ConnectionOptions(depth=self.scene.depth), random=self.random)
        try:
            await connection.open()
            await connection.shake_hands()
        except BaseException:
            await connection.close()
            raise
        return connection

    async def _pull(self) -> None:
        while True:
            await asyncio.sleep(self.random.uniform(*_PULLED_EVERY))
            assert self._cable is not None  # the board is connected
            self.checker.counts["pulled"] += 1
            self._cable.pull()


def relive_sharing(seed: int, steps: int = STEPS) -> HubHistory:
    """Return the history of `seed`."""
    history = HubHistory(HubScene.of(seed))
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        try:
            runner.run(_live(history, steps))
        except Deadlock as error:
            history.faults.append(f"deadlock: {error}")
    return history


async def _live(history: HubHistory, steps: int) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    stage, begun = _Stage(history.scene, loop), loop.now
    checker = stage.checker
    history.faults, history.latest = checker.faults, checker.latest
    async with stage.shared() as hub:
        tags, names = count(1), count(1)
        users = [
            loop.create_task(_use(stage, hub, steps, lambda: next(tags), lambda: next(names)))
            for _ in range(history.scene.programs)
        ]
        for user in users:
            await user
        stage.board.heal()
        if left := hub.status().programs:
            checker.fault(f"{len(left)} programs have not left")
    await asyncio.sleep(0)
    if remaining := asyncio.all_tasks() - {asyncio.current_task()}:
        checker.fault(f"{len(remaining)} tasks are left: {remaining}")
    history.counts.update(checker.counts)
    history.seconds = loop.now - begun


async def _use(stage: _Stage, hub: Hub, steps: int, tags: object, names: object) -> None:
    """Run one program after the other until all of them together have asked often enough."""
    random, checker, loop = stage.random, stage.checker, stage.loop
    while checker.counts["requests"] < steps:
        kind = random.choice(KINDS)
        program: SharingProgram = kind(f"program {names()}", hub, checker, random, tags)  # type: ignore[operator,arg-type]
        await program.join()
        until, is_killed = random.randint(*_LIFE), random.random() < _KILLED
        asked = 0
        while asked < until and not program.is_over and checker.counts["requests"] < steps:
            asked += await program.ask()
            if random.random() < 0.5:
                await asyncio.sleep(random.uniform(0, 0.01))
        if is_killed:
            last = loop.create_task(program.ask())
            await asyncio.sleep(random.uniform(0, 0.02))
            await program.leave()
            last.cancel()
            await asyncio.wait((last,))
            checker.counts["killed"] += 1
        else:
            await program.leave()
