"""Programs that share a board: some with the library, some that only write frames, and all of them killed at times."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from random import Random
from typing import Any, cast

from servolink.client import Board, Session, connect
from servolink.connection import Connection
from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.hub import DirectProgram, Hub
from servolink.motion import AngleUnit, MotionLimits, MotionPlanner
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    AddServoParameterRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    Codec,
    Command,
    DeleteActionRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Frame,
    FrameParser,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActiveJoystickTableRequest,
    QueryJoystickTableRequest,
    QueryMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    Response,
    SendDummyDataRequest,
    ServoParameter,
    SetActiveJoystickTableRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
)
from tests.hub.local_transport import LocalTransport
from tests.proofs.reliability.hub_checker import STOP, Asked, HubChecker, is_change

CANCELLED = 0.02
"""Chance that a caller loses patience."""
_PATIENCE = 0.02
_MOST_AT_ONCE = 6  # queries that a program without the library writes in one go
_GIVEN_UP = 120.0  # seconds after which such a program no longer waits for a response
_HUNG = 900.0  # seconds after which a call of the library has failed
_DEGREES, _RAW = 0, 1
_ALL_SERVOS = QueryServoRequest(ALL_SERVOS)


def _steps(tag: int) -> tuple[Step, ...]:
    return (Step(1 + tag % 3, 90, 1 + tag % 30_000), Step(4, tag // 30_000, 20))


_KINDS: dict[Callable[[int], Packet], float] = {
    lambda tag: QueryProjectIDRequest(): 10,
    lambda tag: QueryMemorySizeRequest(): 8,
    lambda tag: QueryRemainPowerRequest(): 6,
    lambda tag: QueryActiveJoystickTableRequest(): 4,
    QueryActionRequest: 8,
    QueryMacroRequest: 4,
    QueryJoystickTableRequest: 3,
    lambda tag: QueryServoRequest(1 + tag % 3): 8,
    lambda tag: _ALL_SERVOS: 10,
    lambda tag: QueryServoListRequest(): 2,
    lambda tag: QueryActionListRequest(): 1,
    lambda tag: QueryServoParameterRequest(): 1,
    WriteProjectIDRequest: 3,
    lambda tag: AddActionRequest(tag, f"wave {tag}", _steps(tag)): 4,
    DeleteActionRequest: 2,
    lambda tag: AddServoParameterRequest((ServoParameter(1, 2, f"arm {tag}"),)): 1,
    SetActiveJoystickTableRequest: 1,
    lambda tag: SendDummyDataRequest(f"test {tag}".encode()): 1,
    lambda tag: ExecuteActionRequest(_steps(tag)): 5,
    ExecuteActionExRequest: 1,
    ExecuteMacroRequest: 2,
    lambda tag: SetServoParameterRequest(1 + tag % 3, 1, 1): 1,
    lambda tag: ClearAllDataRequest(): 0.5,
    lambda tag: STOP: 0.5,
}
"""Makers of packets from a number that is used once, with their weights."""


class SharingProgram(ABC):
    """One program at a hub."""

    def __init__(self, name: str, hub: Hub, checker: HubChecker, random: Random, tags: Callable[[], int]) -> None:
        """Draw what it does from `random`, with numbers from `tags`, each used once."""
        self.name = name
        self.unit = random.choice((_DEGREES, _RAW))
        self.is_over = False
        """Whether its connection is lost."""
        self._hub, self._checker, self._random, self._tags = hub, checker, random, tags

    def drawn(self) -> Packet:
        """Return something to ask."""
        [make] = self._random.choices(tuple(_KINDS), tuple(_KINDS.values()))
        return make(self._tags())

    @abstractmethod
    async def join(self) -> None:
        """Connect to the hub."""

    @abstractmethod
    async def ask(self) -> int:
        """Ask once, or several things at once; return how many."""

    @abstractmethod
    async def leave(self) -> None:
        """Disconnect, whatever is under way."""


class RawProgram(SharingProgram):
    """Writes frames and takes the responses in the order of its requests, as a program without the library does."""

    async def join(self) -> None:
        """Connect as over TCP."""
        self._codec = Codec("big" if self._random.random() < 0.3 else "little")
        self._parser = FrameParser(self._codec.byte_order)
        self._waiting: deque[Asked] = deque()
        self._idle = asyncio.Event()
        self._program = self._hub.join(
            self._hear, who=self.name, door="tcp", codec=self._codec, unit="degree" if self.unit == _DEGREES else "adc"
        )

    async def ask(self) -> int:
        """Ask several queries at once, or anything else alone."""
        wanted = [self.drawn()]
        if not is_change(wanted[0]):
            more = (self.drawn() for _ in range(self._random.randrange(_MOST_AT_ONCE)))
            wanted += [packet for packet in more if not is_change(packet)]
        asked = [self._checker.asks(self.name, self.unit, packet, at_once=True) for packet in wanted]
        self._waiting.extend(one for one in asked if isinstance(one.request, Request))
        self._idle.clear()
        self._write(b"".join(map(self._codec.encode, wanted)))
        if self._waiting:
            with suppress(TimeoutError):
                async with asyncio.timeout(_GIVEN_UP):
                    await self._idle.wait()
        self._give_up(len(self._waiting))
        return len(wanted)

    async def leave(self) -> None:
        """Vanish."""
        self._give_up(len(self._waiting))
        self._program.leave()

    def _write(self, data: bytes) -> None:
        """Write in one piece or in two, as the system pleases."""
        at = self._random.randrange(len(data))
        for piece in (data[:at], data[at:]):
            if piece:
                self._program.receive(piece)

    def _hear(self, data: bytes) -> None:
        for frame in self._parser.feed(data):
            self._take(frame)

    def _take(self, frame: Frame) -> None:
        response = self._codec.decode(*frame)
        if isinstance(response, ButtonEventResponse):
            self._checker.fault(f"{self.name} heard of a button that it had not asked for")
            return
        fitting = (at for at, asked in enumerate(self._waiting) if _fits(asked.request, response))
        if (at := next(fitting, None)) is None:
            self._checker.unasked(self.name, response)
            return
        self._give_up(at)
        self._checker.answered(self._waiting.popleft(), cast("Response", response))
        if not self._waiting:
            self._idle.set()

    def _give_up(self, count: int) -> None:
        for _ in range(count):
            self._checker.unanswered(self._waiting.popleft())


def _fits(request: Packet, response: Packet) -> bool:
    """Return whether this can be the response to that request: those before it may have none."""
    if not isinstance(request, Request) or response.packet_id != request.packet_id + 1:
        return False
    if request == _ALL_SERVOS and isinstance(response, QueryServoResponse):
        return len(response.servos) > 1
    return request.accepts(cast("Response", response))


class LibraryProgram(SharingProgram):
    """Uses `Board`, as a program with the library does that takes the hub for a board, as over TCP."""

    async def connect(self, transport: LocalTransport) -> Board:
        """Shake hands, and repeat what is not answered."""
        transport.is_recorded = True  # the handshake is always the same
        return await connect(transport, angle_unit=None)

    async def join(self) -> None:
        """Connect in the process of the hub."""
        unit: AngleUnit = "degree" if self.unit == _DEGREES else "adc"
        while True:
            try:
                self._board = await self.connect(LocalTransport(self._hub, who=self.name, unit=unit))
            except OpenError:
                self._checker.counts["not opened"] += 1
            else:
                return

    async def ask(self) -> int:
        """Ask once, and lose patience at times."""
        packet, random, loop = self.drawn(), self._random, asyncio.get_running_loop()
        asked = self._checker.asks(self.name, self.unit, packet, at_once=False)
        task = loop.create_task(self._ask(asked))
        if random.random() < CANCELLED:
            loop.call_later(random.uniform(0, _PATIENCE), task.cancel)
        await asyncio.wait((task,), timeout=_HUNG)
        if not task.done():
            self._checker.hung(asked)
            task.cancel()
        elif task.cancelled():
            self._checker.counts["cancelled"] += 1
        else:
            task.result()
        return 1

    async def leave(self) -> None:
        """Close the board."""
        await self._board.close()

    async def _ask(self, asked: Asked) -> None:
        packet = asked.request
        try:
            if packet == STOP:
                await self._board.stop()
            elif isinstance(packet, Command):
                await self._board.send(packet)
            else:
                self._checker.answered(asked, await self._board.request(cast("Request[Any]", packet)))
        except ConnectionLost:
            self._checker.counts["lost"] += 1
            self.is_over = True
        except ServolinkError:
            self._checker.unanswered(asked)


class PatientProgram(LibraryProgram):
    """Uses `Board` as over `share://`: it asks once, as the hub repeats what the board does not answer."""

    async def connect(self, transport: LocalTransport) -> Board:
        """Open the session, which begins clean."""
        connection = Connection(transport, through_hub=True)
        await connection.open(handshake=False)
        return Board(Session(connection), None, MotionPlanner(MotionLimits()))


class InProcessProgram(LibraryProgram):
    """Uses `Board` within the process of the hub, as the control interface does: its packets do not become bytes."""

    async def join(self) -> None:
        """Join the hub."""
        unit: AngleUnit = "degree" if self.unit == _DEGREES else "adc"
        self._board = Board(
            Session(DirectProgram(self._hub, who=self.name, unit=unit)), None, MotionPlanner(MotionLimits())
        )


KINDS: tuple[type[SharingProgram], ...] = (RawProgram, LibraryProgram, PatientProgram, InProcessProgram)
