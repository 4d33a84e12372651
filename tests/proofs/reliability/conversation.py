"""What programs do with a board: ask, change, move, stop, and lose patience, several at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any, cast

from servolink.client import Board
from servolink.errors import ConnectionLost, DecodeError, OutcomeUnknown, RequestError, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    AddServoParameterRequest,
    ClearAllDataRequest,
    Command,
    DeleteActionRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActiveJoystickTableRequest,
    QueryJoystickTableListRequest,
    QueryJoystickTableRequest,
    QueryMacroListRequest,
    QueryMacroRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    QueryServoRequest,
    Request,
    SendDummyDataRequest,
    ServoParameter,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
)
from tests.proofs.reliability.checker import CALL, Call, Checker
from tests.proofs.reliability.clock import SimulatedLoop
from tests.proofs.reliability.line import STALL, Line

_STEP = Step(1, 90, 20)
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)

_KINDS: dict[Callable[[Random], Packet], float] = {
    lambda random: QueryProjectIDRequest(): 12,
    lambda random: QueryMemorySizeRequest(): 8,
    lambda random: QueryRemainPowerRequest(): 8,
    lambda random: QueryActiveJoystickTableRequest(): 4,
    lambda random: QueryActionRequest(random.randrange(1, 4)): 8,
    lambda random: QueryMacroRequest(random.randrange(1, 4)): 3,
    lambda random: QueryJoystickTableRequest(random.randrange(1, 4)): 2,
    lambda random: QueryServoRequest(random.randrange(1, 4)): 10,
    lambda random: QueryServoRequest(ALL_SERVOS): 8,
    lambda random: QueryServoListRequest(): 2,
    lambda random: QueryActionListRequest(): 1,
    lambda random: QueryMacroListRequest(): 1,
    lambda random: QueryJoystickTableListRequest(): 1,
    lambda random: QueryServoParameterRequest(): 1,
    lambda random: WriteProjectIDRequest(random.randrange(1, 1000)): 3,
    lambda random: AddActionRequest(random.randrange(1, 4), "wave", (_STEP,)): 2,
    lambda random: DeleteActionRequest(random.randrange(1, 4)): 1,
    lambda random: AddServoParameterRequest((ServoParameter(1, 2, "arm"),)): 1,
    lambda random: SetActiveJoystickTableRequest(random.randrange(1, 4)): 1,
    lambda random: SetServoParameterRequest(random.randrange(1, 4), 1, 1): 3,
    lambda random: SetAngleUnitRequest(random.randrange(1, 4), 0): 2,
    lambda random: SendDummyDataRequest(b"test"): 1,
    lambda random: ExecuteActionRequest((_STEP,)): 5,
    lambda random: ExecuteActionExRequest(random.randrange(1, 4)): 3,
    lambda random: ExecuteMacroRequest(random.randrange(1, 4)): 6,
    lambda random: ClearAllDataRequest(): 2.5,
    lambda random: STOP: 0.5,
}


@dataclass(frozen=True, slots=True)
class Load:
    """What callers do."""

    kinds: dict[Callable[[Random], Packet], float]
    """Makers of packets, with their weights."""
    reads_back: bool = False
    """Whether a caller reads back the actions that it writes."""


_RARE: dict[Callable[[Random], Packet], float] = {
    lambda random: QueryProjectIDRequest(): 1,
    lambda random: QueryServoListRequest(): 1,
    lambda random: ExecuteActionRequest((_STEP,)): 1,
    lambda random: SetAngleUnitRequest(random.randrange(1, 4), 0): 0.5,
    lambda random: STOP: 0.5,
}
_WRITES: dict[Callable[[Random], Packet], float] = {
    **_RARE,
    lambda random: AddActionRequest(random.randrange(1, 100), "wave", (_STEP,)): 80,
    lambda random: DeleteActionRequest(random.randrange(1, 100)): 10,
    lambda random: WriteProjectIDRequest(random.randrange(1, 1000)): 2,
}

LOADS = {
    "mixed": Load(_KINDS),
    "telemetry": Load({**_RARE, lambda random: QueryServoRequest(ALL_SERVOS): 95}),
    "records": Load({**_RARE, lambda random: QueryActionRequest(random.randrange(1, 100)): 95}),
    "writes": Load(_WRITES),
    "writes, read back": Load(_WRITES, reads_back=True),
}
"""By name. Boards say of every eighth record that there is none."""

CANCELLED = 0.02
"""Chance that a caller loses patience."""
_PATIENCE = 0.02
_PARTICULAR = 0.1  # chance that a caller says how long to wait
_TIMEOUTS = (0.003, 0.01, 0.05, 0.7)


def drawn(random: Random, load: Load = LOADS["mixed"]) -> Packet:
    """Return something to say to a board."""
    [make] = random.choices(tuple(load.kinds), tuple(load.kinds.values()))
    return make(random)


class Conversation:
    """Callers that share one connection."""

    def __init__(
        self,
        line: Line,
        load: Load,
        random: Random,
        checker: Checker,
        connected: Callable[[], Board],
        reconnect: Callable[[Board], Any],
    ) -> None:
        """Draw what they do from `random`; `reconnect` replaces a connection that was lost."""
        self.steps = 0
        self.calls = 0
        """Steps, and read-backs that belong to them."""
        self._line = line
        self._load = load
        self._random = random
        self._checker = checker
        self._connected = connected
        self._reconnect = reconnect

    async def hold(self, callers: int, steps: int) -> None:
        """Let so many callers do `steps` things in all."""
        until = self.steps + steps
        tasks = [asyncio.get_running_loop().create_task(self._call(until)) for _ in range(callers)]
        for task in tasks:
            await task

    async def _call(self, until: int) -> None:
        random, loop = self._random, asyncio.get_running_loop()
        while self.steps < until:
            self.steps += 1
            packet = drawn(random, self._load)
            call = Call(self.steps, packet, is_stop=packet is STOP)
            if random.random() < _PARTICULAR:
                call.timeout = random.choice(_TIMEOUTS)
            if random.random() < self._line.stalls:
                assert isinstance(loop, SimulatedLoop)
                loop.call_later(random.uniform(0, STALL), loop.stall, STALL)
            if random.random() < CANCELLED:
                task = loop.create_task(self.do(call))
                loop.call_later(random.uniform(0, _PATIENCE), task.cancel)
                await asyncio.wait((task,))
                self._checker.counts["cancelled"] += task.cancelled()
            else:
                await self.do(call)
                if self._load.reads_back and isinstance(packet, AddActionRequest):
                    await self.do(Call(self.steps, QueryActionRequest(packet.action_id)))
            if random.random() < 0.5:
                await asyncio.sleep(random.uniform(0, 0.01))

    async def do(self, call: Call) -> None:
        """Do one thing and let the checker judge how it ends."""
        CALL.set(call)
        self.calls += 1
        loop, checker = asyncio.get_running_loop(), self._checker
        call.begun = checker.number
        if call.timeout is not None:
            call.until = loop.time() + call.timeout
        checker.note(loop.time(), "asked", f"{call.step} {type(call.request).__name__}")
        board = self._connected()
        try:
            how = await self._ask(board, call)
        except ConnectionLost:
            how = "lost"
        except DecodeError:
            how = checker.undecodable(call)
        except OutcomeUnknown:
            how = checker.unanswered(call, unknown=True)
        except RequestTimeout:
            how = checker.unanswered(call, unknown=False)
        except RequestError:
            how = checker.refused(call)
        checker.counts[how] += 1
        checker.note(loop.time(), how, str(call.step))
        if how == "lost":
            await self._reconnect(board)

    async def _ask(self, board: Board, call: Call) -> str:
        packet = call.request
        if call.is_stop:
            await board.stop()
        elif isinstance(packet, Command):
            await board.send(packet)
        else:
            request = cast("Request[Any]", packet)  # neither stop nor command
            return self._checker.answered(call, await board.request(request, timeout=call.timeout))
        return "done"
