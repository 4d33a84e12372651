"""Board without async: the methods of `servolink.Board`, as methods that wait for the result."""

from __future__ import annotations

import weakref
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterable
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from types import TracebackType
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Self, TypeVar

from servolink import client
from servolink.boards import ProfileInUse
from servolink.client import Alarm, Targets
from servolink.connection import Connection, Stats
from servolink.motion import AngleUnit, Degrees, MotionLimits, ServoUnits
from servolink.protocol import Codec
from servolink.sync.iterator import BlockingIterator, ButtonEvents, ServoReadings
from servolink.sync.loop_thread import LoopThread

P = ParamSpec("P")
T = TypeVar("T")


def _blocking(
    method: Callable[Concatenate[client.Board, P], Coroutine[Any, Any, T]],
) -> Callable[Concatenate[Board, P], T]:
    """Return a method that calls the async `method` and waits for the result."""

    @wraps(method)
    def call(self: Board, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return self._thread.run(method, self._board, *args, **kwargs)

    return call


def _iterating(
    method: Callable[Concatenate[client.Board, P], AsyncGenerator[T, None]],
) -> Callable[Concatenate[Board, P], BlockingIterator[T]]:
    """Return a method with a blocking iterator over the items of the async `method`."""

    @wraps(method)
    def call(self: Board, /, *args: P.args, **kwargs: P.kwargs) -> BlockingIterator[T]:
        return BlockingIterator(self._thread, method(self._board, *args, **kwargs), self)

    shown = signature(method)  # the signature in `help`
    items = str(shown.return_annotation).removeprefix("AsyncGenerator[").removesuffix(", None]")
    returns = f"{BlockingIterator.__name__}[{items}]"
    vars(call)["__signature__"] = shown.replace(return_annotation=returns)
    return call


class ServoStream:
    """Stream of set-points, made by `Board.stream`. Nothing need be closed: it ends by a gap or a stop."""

    def __init__(self, thread: LoopThread, stream: client.ServoStream) -> None:
        """Send on the loop of `thread`."""
        self._thread = thread
        self._stream = stream

    def send(self, targets: Targets) -> dict[int, Degrees]:
        """Turn servos toward set-points in degrees, and return the angles sent (see `servolink.ServoStream.send`)."""
        return self._thread.run(self._stream.send, targets)


class Board:
    """Connected board, made by `servolink.sync.connect`.

    The methods are those of `servolink.Board`, with the same arguments, results and errors. Async methods there are
    plain methods here, and return when they are done. Async iterators there, such as `button_events`, are used in a
    `for` loop here.

    Any thread may use the board. Callbacks such as `on_progress` run in the thread of the event loop, and cannot use
    the board.
    """

    def __init__(self, thread: LoopThread, board: client.Board) -> None:
        """Use `connect` instead. Runs on the loop."""
        self._thread = thread
        self._board = board
        thread.at_exit.add(board.close)
        weakref.finalize(self, thread.call_soon, _close, thread, board).atexit = False

    def __repr__(self) -> str:
        """Return address and state, such as `<Board virtual:// connected>`."""
        return repr(self._board)

    if not TYPE_CHECKING:  # or type checkers would accept any name

        def __getattr__(self, name: str) -> object:
            """Raise AttributeError with the most similar public name."""
            similar = get_close_matches(name, [each for each in dir(self) if not each.startswith("_")], 1)
            hint = f"; did you mean {similar[0]!r}?" if similar else ""
            raise AttributeError(
                f"{type(self).__name__!r} has no attribute {name!r}{hint}", name=name
            )  # with the object, Python would add its own hint

    def _repr_html_(self) -> str:
        return self._board._repr_html_()

    def __enter__(self) -> Self:
        """Return the board, closed at the end of the block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the board. No effect in a forked process: the board stays with the parent process."""
        if self._thread.is_here:
            self.close()

    # --- the connection -----------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """Address of the connected board, such as `virtual://`."""
        return self._board.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._board.codec

    @property
    def profile(self) -> ProfileInUse | None:
        """Name and profile of the board; None for an unknown board (see `servolink.connect`)."""
        return self._board.profile

    @property
    def limits(self) -> MotionLimits:
        """Limits of movements, as given to `connect` and tightened by the profile; false without any limit."""
        return self._board.limits

    @property
    def connection(self) -> Connection:
        """Identity of the present connection: a different object after each reconnect."""
        return self._board.connection

    @property
    def unanswered(self) -> frozenset[str]:
        """Names of queries that the board does not answer, such as "QueryProjectID", by profile or on connecting."""
        return self._board.unanswered

    @property
    def stats(self) -> Stats:
        """Counters of the connection: frames, bytes, noise, late responses, round trips."""
        return self._board.stats

    states = _iterating(client.Board.states)
    request = _blocking(client.Board.request)
    send = _blocking(client.Board.send)
    took_effect = _blocking(client.Board.took_effect)

    def close(self) -> None:
        """Unsubscribe from button events, close the connection and free the port; may be called again."""
        if not self._thread.has_ended:
            self._thread.run(_close, self._thread, self._board)

    # --- 3.1 settings -------------------------------------------------------------------------------------------

    set_transmission_mode = _blocking(client.Board.set_transmission_mode)
    clear_all_data = _blocking(client.Board.clear_all_data)
    memory = _blocking(client.Board.memory)
    battery = _blocking(client.Board.battery)
    send_dummy_data = _blocking(client.Board.send_dummy_data)

    # --- 3.2 servos ---------------------------------------------------------------------------------------------

    servo_ids = _blocking(client.Board.servo_ids)
    servos = _blocking(client.Board.servos)

    def watch(self, hz: float | None = None, *, alarms: Iterable[Alarm] = ()) -> ServoReadings:
        """Return an iterator over readings of all servos (3.2.2), `hz` times a second (0 < hz <= 1000).

        Without `hz`, servos are read as often as the line allows, and more often with a `depth` above 1 (see
        `connect`). All iterators of a board share the same readings. A reading has `seconds`, `servos`, `missed` and
        `alarms`, the raised alarms (see `ServoReading`). An alarm with `stops` stops all servos immediately.
        """
        return ServoReadings(self._thread, self._thread.run(_made, self._board.watch, hz, alarms=alarms), self)

    servo = _blocking(client.Board.servo)
    set_servo = _blocking(client.Board.set_servo)
    release = _blocking(client.Board.release)
    stop = _blocking(client.Board.stop)
    set_angle_unit = _blocking(client.Board.set_angle_unit)

    def unit_of(self, servo_id: int) -> AngleUnit | None:
        """Return the angle unit of a servo, None if unknown. Takes an id, no caption, and sends no query."""
        return self._board.unit_of(servo_id)

    @property
    def units(self) -> ServoUnits:
        """Known angle units of the servos. To be changed by `set_angle_unit` only."""
        return self._board.units

    move = _blocking(client.Board.move)

    def stream(self, hz: float = 50.0, *, gap: float = 0.5, any_angle: bool = False) -> ServoStream:
        """Return a stream of set-points (3.2.5), at most `hz` a second (0 < hz <= 100), as from a gamepad or a policy.

        `stream.send({1: 30.5})` turns servos toward angles in degrees, kept to the limits, and returns the angles sent.
        The stream ends with a stop, with a loss of the connection, and when no set-point is given for `gap` seconds.
        """
        return ServoStream(self._thread, self._thread.run(_made, self._board.stream, hz, gap=gap, any_angle=any_angle))

    follow = _iterating(client.Board.follow)
    run_action = _blocking(client.Board.run_action)
    play = _blocking(client.Board.play)

    # --- 3.3 stored records -------------------------------------------------------------------------------------

    actions = _blocking(client.Board.actions)
    action = _blocking(client.Board.action)
    add_action = _blocking(client.Board.add_action)
    delete_action = _blocking(client.Board.delete_action)
    macros = _blocking(client.Board.macros)
    macro = _blocking(client.Board.macro)
    add_macro = _blocking(client.Board.add_macro)
    delete_macro = _blocking(client.Board.delete_macro)
    run_macro = _blocking(client.Board.run_macro)
    servo_parameters = _blocking(client.Board.servo_parameters)
    add_servo_parameters = _blocking(client.Board.add_servo_parameters)
    write_project_id = _blocking(client.Board.write_project_id)
    project_id = _blocking(client.Board.project_id)

    # --- 3.4 joystick -------------------------------------------------------------------------------------------

    joystick_tables = _blocking(client.Board.joystick_tables)
    joystick_table = _blocking(client.Board.joystick_table)
    add_joystick_table = _blocking(client.Board.add_joystick_table)
    delete_joystick_table = _blocking(client.Board.delete_joystick_table)
    set_active_joystick_table = _blocking(client.Board.set_active_joystick_table)
    active_joystick_table = _blocking(client.Board.active_joystick_table)

    def button_events(self, limit: int = 256) -> ButtonEvents:
        """Return an iterator over button events, subscribed on first use (3.4.7, 3.4.8).

        Up to `limit` unread events are kept; the oldest are dropped and counted.
        """
        return ButtonEvents(self._thread, self._thread.run(_made, self._board.button_events, limit), self)

    # --- 4 projects ---------------------------------------------------------------------------------------------

    export_project = _blocking(client.Board.export_project)
    plan_project = _blocking(client.Board.plan_project)
    apply_project = _blocking(client.Board.apply_project)
    rollback_project = _blocking(client.Board.rollback_project)
    has_unfinished_import = _blocking(client.Board.has_unfinished_import)


def loop_and_board(board: Board) -> tuple[LoopThread, client.Board]:
    """Return the thread of a board, and its async board in that thread."""
    return board._thread, board._board  # noqa: SLF001 - for other modules of this package only


async def _made(make: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Return the result of `make`, called on the loop: two threads could each make a shared part of the board."""
    return make(*args, **kwargs)


async def _close(thread: LoopThread, board: client.Board) -> None:
    await board.close()
    thread.at_exit.discard(board.close)
