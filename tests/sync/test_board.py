"""servolink.sync: all that servolink does, without `async`.

Module: servolink.sync.loop_thread.
"""

from __future__ import annotations

import asyncio
import gc
import inspect
import threading
import traceback
from pathlib import Path
from typing import Any, Literal, assert_type, cast

import pytest

import servolink
import servolink.sync
from servolink import Servo
from servolink.client import Board, ButtonSubscription, ServoWatch, Session
from servolink.errors import ConnectionLost, NotFound, OpenError, RequestError, RequestTimeout
from servolink.protocol import (
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    SubscribeButtonEventRequest,
)
from servolink.sync.iterator import BlockingIterator
from servolink.sync.loop_thread import running_thread
from servolink.transports import DeviceInfo
from tests.client.piped_board import LOST, PipedBoard
from tests.sync.sync_board import on_loop, opened
from tests.tables import over

PUBLIC = [name for name in vars(Board) if not name.startswith("_")]


def is_async(thing: object) -> bool:
    return inspect.iscoroutinefunction(thing) or inspect.isasyncgenfunction(inspect.unwrap(cast("Any", thing)))


# --- nothing is missing, and nothing is otherwise -----------------------------------------------------------------


@over("name", PUBLIC)
def test_every_method_is_there_with_the_same_signature(name: str) -> None:
    method = inspect.getattr_static(Board, name)
    here = inspect.getattr_static(servolink.sync.Board, name, None)
    line = f"{name} = {'_blocking' if is_async(method) else '_iterating'}(client.Board.{name})"
    missing = f"the property {name}" if isinstance(method, property) else f"`{line}`"
    assert here is not None, f"add {missing} to servolink/sync/board.py"
    assert inspect.getdoc(here)
    if isinstance(method, property):
        assert isinstance(here, property)
        method, here = method.fget, here.fget
    assert callable(method)
    assert callable(here)
    expected, signature = inspect.signature(method), inspect.signature(here)
    assert signature.parameters == expected.parameters
    returns = str(expected.return_annotation)
    if returns.startswith("AsyncGenerator["):
        returns = f"{BlockingIterator.__name__}[{returns[15:].removesuffix(', None]')}]"
    assert str(signature.return_annotation) == returns
    assert not is_async(here)


def test_there_are_no_other_methods() -> None:
    assert {name for name in vars(servolink.sync.Board) if not name.startswith("_")} == set(PUBLIC)


def test_every_async_function_is_there_with_the_same_arguments() -> None:
    things = {name: getattr(servolink, name) for name in servolink.__all__}
    asynchronous = [name for name, thing in things.items() if is_async(thing)]
    for name in ["connect", *asynchronous]:
        here = getattr(servolink.sync, name)
        assert inspect.signature(here).parameters == inspect.signature(things[name]).parameters, name
    assert sorted(asynchronous) == ["discover", "reconnecting"]


def test_it_is_found_in_the_package() -> None:
    assert servolink.sync.connect is not None
    assert "sync" in dir(servolink)


def test_iterators_of_many_threads_share_one_part_of_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    makers = []

    def made(self: object, session: Session, *others: object) -> None:
        makers.append(threading.current_thread())

    monkeypatch.setattr(ButtonSubscription, "__init__", made)
    monkeypatch.setattr(ServoWatch, "__init__", made)
    with opened(PipedBoard()) as board:
        for make in (board.button_events, board.watch):
            threads = [threading.Thread(target=make) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        # Never in the threads themselves: on Python 3.12 and later nothing keeps both from making one.
        assert makers == [running_thread()._thread] * 2
        monkeypatch.undo()
        vars(board._board).pop("_buttons")
        vars(board._board).pop("_watch")


# --- calls --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("servoids", "; did you mean 'servo_ids'?"),
        ("mve", "; did you mean 'move'?"),
        ("xylophone", ""),
        ("_xylophone", ""),
    ],
)
def test_a_misspelt_method_suggests_the_right_one(name: str, hint: str) -> None:
    with opened(PipedBoard()) as board, pytest.raises(AttributeError) as error:
        getattr(board, name)
    assert str(error.value) == f"'Board' has no attribute '{name}'{hint}"
    assert "Did you mean" not in "".join(traceback.format_exception(error.value))


def test_a_button_event_prints_under_its_public_name() -> None:
    assert repr(servolink.ButtonEvent(3, 1)) == "ButtonEvent(button_id=3, event=1)"


def test_a_script_without_async() -> None:
    with servolink.sync.connect("virtual://?servos=2") as board:
        assert board.servo_ids() == (1, 2)
        assert board.move({1: 30}, duration=0.05, wait=True) == pytest.approx(0.05)
        assert board.servo(1).angle == pytest.approx(30, abs=2)
        assert board.request(QueryServoListRequest()) == QueryServoListResponse((1, 2))
        assert board.unit_of(1) == "degree"
        assert board.url == "virtual://?servos=2"
        assert board.codec.byte_order == "little"
        assert board.stats.frames_sent > 0
        assert board.connection is board.connection
        assert repr(board) == "<Board virtual://?servos=2 connected>"
    assert repr(board) == "<Board virtual://?servos=2 closed>"
    board.close()
    with pytest.raises(ConnectionLost, match="closed by this program"):
        board.servo_ids()


def test_boards_that_are_not_closed_are_closed_when_they_are_dropped(tmp_path: Path) -> None:
    state = tmp_path / "board.json"
    board = servolink.sync.connect(f"virtual://?state={state}")
    board.write_project_id(5)
    assert not state.exists()
    del board
    gc.collect()
    on_loop(lambda: None)  # closing was begun before this
    servolink.sync.connect("virtual://").close()  # it takes some turns of the loop
    assert state.exists()


def test_errors_keep_their_type_and_lose_the_frames_inside_the_library() -> None:
    with servolink.sync.connect("virtual://?servos=2") as board, pytest.raises(NotFound, match="no servo 9") as found:
        board.servo(9)
    frames = traceback.extract_tb(found.tb)
    assert [frame.name for frame in frames] == [frames[0].name, "call", "run"]
    assert found.value.request is not None


def test_other_errors_show_where_they_come_from() -> None:
    def fail(progress: object) -> None:
        raise ZeroDivisionError

    with servolink.sync.connect("virtual://?servos=2") as board, pytest.raises(ZeroDivisionError) as found:
        board.export_project(on_progress=fail)
    assert traceback.extract_tb(found.tb)[-1].name == "fail"


def test_a_callback_that_ends_the_program_ends_neither_the_thread_nor_the_connection() -> None:
    def fail(progress: object) -> None:
        raise SystemExit(4)

    with servolink.sync.connect("virtual://?servos=2") as board:
        with pytest.raises(SystemExit):
            board.export_project(on_progress=fail)
        assert board.servo_ids() == (1, 2)


def test_a_callback_that_uses_the_board_is_told_why_it_cannot() -> None:
    with (
        servolink.sync.connect("virtual://?servos=2") as board,
        pytest.raises(RuntimeError, match=r"on_progress cannot call servolink\.sync"),
    ):
        board.export_project(on_progress=lambda progress: print(board.servos()))


def test_wrong_arguments_are_refused_as_in_python() -> None:
    board: Any
    with servolink.sync.connect("virtual://") as board:
        with pytest.raises(TypeError, match="missing 1 required positional argument: 'targets'"):
            board.move()
        with pytest.raises(TypeError, match="unexpected keyword argument 'pace'"):
            board.move({}, pace=3)


def test_a_board_that_cannot_be_opened_raises_what_connect_raises() -> None:
    with pytest.raises(OpenError, match="nowhere"):
        servolink.sync.connect("/dev/nowhere")
    with pytest.raises(ValueError, match="angle_unit must be"):
        servolink.sync.connect("virtual://", angle_unit="turns")  # type: ignore[arg-type]


def test_many_threads_share_a_board() -> None:
    results: list[tuple[int, ...]] = []

    def work() -> None:
        results.extend(board.servo_ids() for _ in range(20))

    with servolink.sync.connect("virtual://?servos=3") as board:
        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert results == [(1, 2, 3)] * 80


def test_it_works_inside_another_event_loop_as_in_notebooks() -> None:
    async def cell() -> tuple[int, ...]:
        with servolink.sync.connect("virtual://?servos=2") as board:
            return board.servo_ids()

    assert asyncio.run(cell()) == (1, 2)


def test_a_lost_board_fails_the_call_that_waits() -> None:
    fake = PipedBoard(usual=LOST)
    with opened(fake) as board:
        threading.Timer(0.05, on_loop, [fake.vanish]).start()
        with pytest.raises(ConnectionLost):
            board.servos()


def test_a_request_has_its_time() -> None:
    with opened(PipedBoard(usual=LOST)) as board, pytest.raises(RequestTimeout):
        board.request(QueryServoListRequest(), timeout=0.05)


def test_type_checkers_know_what_the_methods_return() -> None:
    with servolink.sync.connect("virtual://?servos=1") as board:  # checked by mypy and pyright, and here too
        assert_type(board, servolink.sync.Board)
        assert_type(board.servos(), tuple[Servo, ...])
        assert_type(board.move({1: 5}, speed=100), float)
        assert_type(board.request(QueryServoListRequest()), QueryServoListResponse)
        assert_type(next(board.states()), Literal["connected", "lost", "closed"])
        assert_type(next(board.follow({1: 5}, 0)), tuple[Servo, ...])
        assert_type([*board.button_events().within(0)], list[servolink.ButtonEvent])


# --- finding and losing boards ------------------------------------------------------------------------------------


def test_discover_returns_what_the_search_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [DeviceInfo("serial:///dev/ttyX")]
    monkeypatch.setattr(servolink.sync, "search", lambda: found)
    assert servolink.sync.discover() == found


def test_reconnecting_yields_a_board_after_each_loss() -> None:
    seen = []
    for board in servolink.sync.reconnecting("virtual://?servos=2"):
        seen.append(board.servo_ids())
        if len(seen) == 2:
            break
        board.close()
    assert seen == [(1, 2), (1, 2)]


def test_the_iterator_of_a_board_keeps_it_open() -> None:
    fake = PipedBoard()
    fake.greeting = True
    events = iter(servolink.sync.connect(fake).button_events())
    gc.collect()
    fake.greeting = False
    assert not list(events.within(0.05))
    assert fake.executed_of(SubscribeButtonEventRequest)
    assert fake.closed == 0


def test_set_points_are_streamed_without_async() -> None:
    fake = PipedBoard()
    with opened(fake) as board:
        stream = board.stream(hz=100)
        assert stream.send({1: 12.4}) == {1: 12}
        assert [stream.send({1: angle}) for angle in range(3)] == [{1: 0}, {1: 1}, {1: 2}]
        board.stop()
        with pytest.raises(RequestError, match="ended by a stop"):
            stream.send({1: 5})
    assert len(fake.executed_of(ExecuteActionRequest)) == 4
