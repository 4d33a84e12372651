"""Tests of programs without hardware and without waiting: virtual time, and a board that misbehaves on request."""

from __future__ import annotations

import asyncio
import selectors
import sys
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from itertools import count
from typing import Any, TypeVar

from servolink.client import connect
from servolink.protocol import PACKETS, ByteOrder, Codec, Packet, Request, Result
from servolink.virtual import BOARDS, BoardKind, RequestContext, Response, VirtualBoard, parse_script

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

    if sys.platform == "emscripten":  # no sockets, of which other threads would write to one to wake the loop

        def _make_self_pipe(self) -> None:
            """Make nothing: there are no other threads."""

        _close_self_pipe = _write_to_self = _make_self_pipe


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

_numbers = count(1)


@dataclass(frozen=True, slots=True)
class Fate:
    """Fate of a request and of its response, by default as on a board without faults."""

    executes: bool = True
    """Whether the board executes the request. Otherwise it sends no response, or `says`."""
    answers: bool = True
    """Whether a response is sent."""
    delay: float = 0.0
    """Seconds that the response comes later, at least 0; later responses wait."""
    says: Packet | bool | None = None
    """Response in place of the true one, not checked, or the result of a response that has one; None for the truth."""
    copies: int = 1
    """Number of times that the response is sent."""
    damage: Callable[[bytes], bytes] = bytes
    """Function from the frame of the response to the bytes that are sent."""
    unplugs: bool = False
    """Whether all connections are lost when the request arrives, before it takes effect."""


class FakeBoard(VirtualBoard):
    """Virtual board at an address of its own, with a list of the received requests, and with planned faults.

    A fault is planned for the next request of one of the classes in `requests`, such as `AddActionRequest`, or of any
    class without `requests`; with `times`, for so many such requests. A request meets one fault at most, the first of
    those planned. Queries are repeated by the client if no response comes, commands are not. Methods that plan a fault
    raise ValueError if `times` is below 1.
    """

    def __init__(
        self,
        servos: int = 16,
        *,
        seed: int = 0,
        kind: BoardKind = BoardKind.DEFAULT,
        byte_order: ByteOrder = "little",
        usual: Fate | None = None,
    ) -> None:
        """Switch on a board, as `VirtualBoard` does. Raise ValueError for a value out of range."""
        super().__init__(servos, seed, Codec(byte_order), kind)
        name = f"fake-{next(_numbers)}"
        BOARDS[name] = self
        self.url = f"virtual://{name}"
        """Address of the board in this program, for `connect` and `reconnecting`; faults of the line may be added."""
        self.requests: list[Packet] = []
        """Received requests in order, including requests of connecting and requests with a fault."""
        self.usual = usual or Fate()
        """Fate of requests for which nothing is planned; may be changed at any time."""
        self.usual_of: dict[type[Packet], Fate] = {}
        """Fate of requests of single classes for which nothing is planned, in place of `usual`."""
        self._plans: list[tuple[type[Packet] | tuple[type[Packet], ...], Fate]] = []
        self._fate = self.usual  # of the request in hand

    def connect(self, **options: Any) -> connect:
        """Return `servolink.connect` for this board, with the same options: `async with fake.connect() as board:`."""
        return connect(self.url, **options)

    def received(self, request: type[P]) -> list[P]:
        """Return the received requests of a class, in order."""
        return [each for each in self.requests if isinstance(each, request)]

    def plan(self, requests: type[Packet] | tuple[type[Packet], ...], *fates: Fate) -> None:
        """Plan fates of the next requests of a class, or of one of several, in order; `Packet` is any class."""
        self._plans += [(requests, fate) for fate in fates]

    def forget_plans(self) -> None:
        """Plan nothing any more, also for single classes; `usual` stays."""
        self._plans.clear()
        self.usual_of.clear()

    def drop(self, *requests: type[Packet], times: int = 1) -> None:
        """Lose the request on its way: the board does nothing."""
        self._repeat(requests, times, Fate(executes=False))

    def drop_response(self, *requests: type[Packet], times: int = 1) -> None:
        """Execute the request, and lose the response on its way."""
        self._repeat(requests, times, Fate(answers=False))

    def delay(self, seconds: float, *requests: type[Packet], times: int = 1) -> None:
        """Take `seconds` longer for the request; later requests wait."""
        self._repeat(requests, times, Fate(delay=seconds))

    def refuse(self, *requests: type[Request[Result]], times: int = 1) -> None:
        """Respond with the result 0, without any effect. Raise TypeError for a class without such a response."""
        for request in requests:
            if not issubclass(PACKETS[request.packet_id + 1], Result):
                raise TypeError(f"{request.__name__} cannot be refused: the response has no result")
        self._repeat(requests, times, Fate(executes=False, says=False))

    def lose_connection(self, *requests: type[Packet], times: int = 1) -> None:
        """Lose all connections before the request takes effect; without `requests`, immediately."""
        if requests:
            self._repeat(requests, times, Fate(unplugs=True))
        else:
            self.unplug(asyncio.get_running_loop().time())

    def script(self, text: str) -> None:
        """Let happen what a script says, from now on: buttons, pushed servos, power (see `servolink virtual`).

        Raise ValueError with the number of a wrong line.
        """
        loop = asyncio.get_running_loop()
        for event in parse_script(text):
            loop.call_later(event.at, event.apply, self, loop.time() + event.at)

    def handle(self, context: RequestContext[Any]) -> tuple[Response, float]:
        """Execute a request, with the first fate planned for it."""
        self.requests.append(context.request)
        fate = self._fate = self.fate_of(context.request)
        if fate.unplugs:
            self.unplug()
            return None, 0.0
        response: Response = fate.says
        working = 0.0 if fate.says is None else self.kind.turnaround
        if fate.executes:
            truth, working = VirtualBoard.handle(self, context)
            response = truth if fate.says is None else fate.says
        return response if fate.answers else None, working + fate.delay

    def frame(self, packet_id: int, response: Response) -> bytes | None:
        """Return what is sent for a response to the request in hand: damaged, or several times, if so planned."""
        if isinstance(response, Packet):
            frame: bytes | None = self.codec.encode(response, unchecked=True)
        else:
            frame = super().frame(packet_id, response)
        return None if frame is None else b"".join(self._fate.damage(frame) for _ in range(self._fate.copies))

    def fate_of(self, request: Packet) -> Fate:
        """Return the fate of a request that has arrived, which is no longer planned then."""
        for number, (requests, fate) in enumerate(self._plans):
            if isinstance(request, requests):
                del self._plans[number]
                return fate
        return self.usual_of.get(type(request), self.usual)

    def _repeat(self, requests: tuple[type[Packet], ...], times: int, fate: Fate) -> None:
        if times < 1:
            raise ValueError(f"times must be at least 1, not {times}")
        self.plan(requests or Packet, *[fate] * times)
