"""Tests of programs without hardware and without waiting: virtual time, and a board that misbehaves on request."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from itertools import count
from typing import Any, TypeAlias, TypeVar

from servolink.client.connect import connect
from servolink.protocol.codec import PACKETS
from servolink.protocol.packet import Packet, Request, Result
from servolink.virtual.board import VirtualBoard
from servolink.virtual.board_script import apply, parse_script
from servolink.virtual.handlers import RequestContext, Response
from servolink.virtual.kind import DEFAULT_KIND, BoardKind
from servolink.virtual.transport import BOARDS

T = TypeVar("T")
P = TypeVar("P", bound=Packet)


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop in which sleeping costs nothing: when nothing is ready, time moves on to the next timer.

    Only for programs in one process: a real board, or another program, needs real time for each response.
    """

    def __init__(self, selector: Callable[[VirtualTimeLoop], selectors.BaseSelector] | None = None) -> None:
        """Start at 1000 seconds; `selector` makes the selector, by default one that never waits."""
        self.now = 1000.0
        """Virtual time in seconds."""
        super().__init__((selector or _JumpingSelector)(self))

    def time(self) -> float:
        """Return the virtual time in seconds."""
        return self.now

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:  # type: ignore[override]
        """Call `func` at once: work in a thread takes no virtual time."""
        done: asyncio.Future[Any] = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:  # noqa: BLE001 - raised where the result is awaited
            done.set_exception(error)
        return done

    def stall(self, seconds: float) -> None:
        """Let `seconds` pass while the loop is busy, as a blocking call in a callback would."""
        self.now += seconds


class _JumpingSelector(selectors.DefaultSelector):
    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            raise RuntimeError("deadlock: nothing is ready, nothing is timed, and the test still waits")
        self._loop.now += timeout
        return ready


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run `main` in virtual time and return its result. Raise AssertionError if tasks are left behind."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(_without_tasks(main))


async def _without_tasks(main: Coroutine[Any, Any, T]) -> T:
    result = await main
    await asyncio.sleep(0)
    if remaining := asyncio.all_tasks() - {asyncio.current_task()}:
        raise AssertionError(f"tasks left behind: {remaining}")
    return result


# --- a board for tests of programs ------------------------------------------------------------------------------------

_Fault: TypeAlias = Callable[[RequestContext[Any]], tuple[Response, float]]
_numbers = count(1)


class FakeBoard(VirtualBoard):
    """Virtual board at an address of its own, with a list of the received requests, and with planned faults.

    A fault is planned for the next request of one of the classes in `requests`, such as `AddActionRequest`, or of any
    class without `requests`; with `times`, for so many such requests. A request meets one fault at most, the first of
    those planned. Queries are repeated by the client if no response comes, commands are not. Methods that plan a fault
    raise ValueError if `times` is below 1.
    """

    def __init__(self, servos: int = 16, *, seed: int = 0, kind: BoardKind = DEFAULT_KIND) -> None:
        """Switch on a board, as `VirtualBoard` does. Raise ValueError for a value out of range."""
        super().__init__(servos, seed, kind=kind)
        name = f"fake-{next(_numbers)}"
        BOARDS[name] = self
        self.url = f"virtual://{name}"
        """Address of the board in this program, for `connect` and `reconnecting`; faults of the line may be added."""
        self.requests: list[Packet] = []
        """Received requests in order, including requests of connecting and requests with a fault."""
        self._faults: list[tuple[tuple[type[Packet], ...], _Fault]] = []

    def connect(self, **options: Any) -> connect:
        """Return `servolink.connect` for this board, with the same options: `async with fake.connect() as board:`."""
        return connect(self.url, **options)

    def received(self, request: type[P]) -> list[P]:
        """Return the received requests of a class, in order."""
        return [each for each in self.requests if isinstance(each, request)]

    def drop(self, *requests: type[Packet], times: int = 1) -> None:
        """Lose the request on its way: the board does nothing."""
        self._plan(requests, times, lambda context: (None, 0.0))

    def drop_response(self, *requests: type[Packet], times: int = 1) -> None:
        """Execute the request, and lose the response on its way."""
        self._plan(requests, times, lambda context: (None, VirtualBoard.handle(self, context)[1]))

    def delay(self, seconds: float, *requests: type[Packet], times: int = 1) -> None:
        """Take `seconds` longer for the request; later requests wait."""

        def late(context: RequestContext[Any]) -> tuple[Response, float]:
            response, working = VirtualBoard.handle(self, context)
            return response, working + seconds

        self._plan(requests, times, late)

    def refuse(self, *requests: type[Request[Result]], times: int = 1) -> None:
        """Respond with the result 0, without any effect. Raise TypeError for a class without such a response."""
        for request in requests:
            if not issubclass(PACKETS[request.packet_id + 1], Result):
                raise TypeError(f"{request.__name__} cannot be refused: the response has no result")
        self._plan(requests, times, lambda context: (False, self.kind.turnaround))

    def lose_connection(self, *requests: type[Packet], times: int = 1) -> None:
        """Lose all connections before the request takes effect; without `requests`, immediately."""

        def lose(context: RequestContext[Any]) -> tuple[Response, float]:
            self.unplug()
            return None, 0.0

        if requests:
            self._plan(requests, times, lose)
        else:
            self.unplug(asyncio.get_running_loop().time())

    def script(self, text: str) -> None:
        """Let happen what a script says, from now on: buttons, pushed servos, power (see `servolink virtual`).

        Raise ValueError with the number of a wrong line.
        """
        loop = asyncio.get_running_loop()
        for event in parse_script(text):
            due = loop.time() + event.at
            loop.call_at(due, apply, self, event, due)

    def handle(self, context: RequestContext[Any]) -> tuple[Response, float]:
        """Execute a request, with the first fault planned for it."""
        self.requests.append(context.request)
        for planned in self._faults:
            if isinstance(context.request, planned[0] or Packet):
                self._faults.remove(planned)
                return planned[1](context)
        return VirtualBoard.handle(self, context)

    def _plan(self, requests: tuple[type[Packet], ...], times: int, fault: _Fault) -> None:
        if times < 1:
            raise ValueError(f"times must be at least 1, not {times}")
        self._faults += [(requests, fault)] * times
