"""The kinds of movements, as a program with the library makes them, and as one with the control interface does."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from servolink.client import Board
from servolink.fleet import Fleet
from tests.proofs.reliability.stop_line import PROJECT

OPTIONS: dict[str, dict[str, Any]] = {
    "soft start": {"soft_start": 120},
    "macro after a soft start": {"soft_start": 120},
}
"""Options of the connection with the board, by movement."""
FROM_REST = {"started servos", "start of all servos"}
"""Movements that begin with stopped servos."""

_TIME = 0.3
_PERIOD = 0.02
_SET_POINTS = 8


class Call(Protocol):
    """Call of a method or a tool."""

    async def __call__(self, method: str, /, **params: Any) -> Any:
        """Return the result. Raise the error of the library that comes in its place."""


async def _stream(board: Board) -> None:
    stream = board.stream(1 / _PERIOD)
    for number in range(1, _SET_POINTS):
        await stream.send({1: 4 * number, 2: -3 * number})
        await asyncio.sleep(_PERIOD)


async def _many(board: Board) -> None:
    moves = (board.move({servo: 10 * number}, duration=_TIME) for number in (2, -1) for servo in (1, 2, 3))
    await asyncio.gather(*moves)


BY_LIBRARY: dict[str, Callable[[Board], Awaitable[object]]] = {
    "one servo": lambda board: board.move({1: 40}, duration=_TIME, wait=True),
    "all servos": lambda board: board.move({"all": 30}, duration=_TIME, wait=True),
    "at a speed": lambda board: board.move({1: 40, 2: -20}, speed=150, wait=True),
    "started servos": lambda board: board.move({1: 40, 2: 20}, duration=_TIME, start=True, wait=True),
    "soft start": lambda board: board.move({1: 40}, duration=_TIME, wait=True),
    "many at once": _many,
    "stream": _stream,
    "stored action": lambda board: board.run_action("Wave", wait=True),
    "stored macro": lambda board: board.run_macro("Dance", wait=True),
    "macro after a soft start": lambda board: board.run_macro("Dance", wait=True),
    "played project": lambda board: board.play(PROJECT, "Dance"),
}


async def _rpc_stream(call: Call) -> None:
    stream = (await call("stream.begin", hz=1 / _PERIOD))["stream"]
    for number in range(1, _SET_POINTS):
        await call("stream.send", stream=stream, targets={"1": 4 * number, "2": -3 * number})
        await asyncio.sleep(_PERIOD)


async def _rpc_many(call: Call) -> None:
    targets = ({str(servo): 10 * number} for number in (2, -1) for servo in (1, 2, 3))
    await asyncio.gather(*(call("move", targets=target, duration=_TIME) for target in targets))


async def _press_and_hold(call: Call) -> None:
    await call("move", targets={"1": 60}, duration=2 * _TIME)
    await asyncio.sleep(_TIME)
    await call("move.end", servos=[1])


async def _prepared(call: Call) -> None:
    await call("run.prepare", type="macro", id="Dance")
    await call("run.start", at=asyncio.get_running_loop().time() + _TIME)


BY_RPC: dict[str, Callable[[Call], Awaitable[object]]] = {
    "one servo": lambda call: call("move", targets={"1": 40}, duration=_TIME, wait=True),
    "all servos": lambda call: call("move", targets={"all": 30}, duration=_TIME, wait=True),
    "at a speed": lambda call: call("move", targets={"1": 40, "2": -20}, speed=150, wait=True),
    "started servos": lambda call: call("move", targets={"1": 40}, duration=_TIME, start=True, wait=True),
    "soft start": lambda call: call("move", targets={"1": 40}, duration=_TIME, wait=True),
    "many at once": _rpc_many,
    "stream": _rpc_stream,
    "stored action": lambda call: call("run", type="action", id="Wave", wait=True),
    "stored macro": lambda call: call("run", type="macro", id="Dance", wait=True),
    "macro after a soft start": lambda call: call("run", type="macro", id="Dance", wait=True),
    "press and hold": _press_and_hold,
    "prepared macro": _prepared,
}


BY_MODEL: dict[str, Callable[[Call], Awaitable[object]]] = {
    "one servo": lambda call: call("move", targets={"1": 40}, duration=_TIME),
    "at a speed": lambda call: call("move", targets={"1": 40, "2": -20}, speed=150),
    "soft start": lambda call: call("move", targets={"1": 40}, duration=_TIME),
    "stored action": lambda call: call("run", kind="action", name="Wave"),
    "stored macro": lambda call: call("run", kind="macro", name="Dance"),
    "start of all servos": lambda call: call("start"),
}

BY_SHELL: dict[str, tuple[str, ...]] = {
    "one servo": ("move", "1=90", "--duration", "3"),
    "all servos": ("move", "all=90", "--duration", "3"),
    "at a speed": ("move", "1=90", "2=-60", "--speed", "30"),
    "started servos": ("move", "1=90", "--duration", "3", "--start"),
    "stored action": ("run", "action", "Wave", "--wait"),
    "stored macro": ("run", "macro", "Dance", "--wait"),
}
"""Arguments of `servolink`; a stop takes as long as a program takes to start."""

BY_FLEET: dict[str, Callable[[Call, Fleet], Awaitable[object]]] = {
    "one servo": lambda call, fleet: BY_RPC["one servo"](call),
    "all servos": lambda call, fleet: BY_RPC["all servos"](call),
    "at a speed": lambda call, fleet: BY_RPC["at a speed"](call),
    "started servos": lambda call, fleet: BY_RPC["started servos"](call),
    "stored action": lambda call, fleet: BY_RPC["stored action"](call),
    "stored macro": lambda call, fleet: BY_RPC["stored macro"](call),
    "many at once": lambda call, fleet: BY_RPC["many at once"](call),
    "macro of all boards": lambda call, fleet: fleet.run("Dance"),
}
