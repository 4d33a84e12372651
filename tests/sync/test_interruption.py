"""Ctrl-C, the end of the program and forks, with servolink.sync: in programs of their own."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests import processes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")

CTRL_C = """
import os, signal, threading, time
import servolink.sync

def ctrl_c(when):
    def send():
        while not when():  # nothing tells another thread that the main one waits for a response
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGINT)
    threading.Thread(target=send, daemon=True).start()  # it waits for ever if the program fails before
"""


def run(program: str, *arguments: str) -> tuple[int, str, str]:
    """Return the exit code of a program, and what it prints."""
    done = processes.run([sys.executable, "-W", "error", "-c", program, *arguments])
    return done.returncode, done.stdout, done.stderr


def test_ctrl_c_ends_a_call_and_the_board_can_still_be_used() -> None:
    program = (
        CTRL_C
        + """
board = servolink.sync.connect("virtual://?servos=2")
sent = board.stats.frames_sent
ctrl_c(lambda: board.stats.frames_sent > sent + 1)
try:
    board.move({1: 90}, duration=300, wait=True)
except KeyboardInterrupt:
    print("interrupted")
print(board.servo_ids(), board.stats.retries)
"""
    )
    assert run(program) == (0, "interrupted\n(1, 2) 0\n", "")


def test_ctrl_c_ends_the_wait_for_an_event_and_loses_none() -> None:
    program = (
        CTRL_C
        + """
from servolink.sync.loop_thread import running_thread
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import VirtualTransport

async def press(button):
    virtual.press_button(button, time.monotonic())

virtual = VirtualBoard()
board = servolink.sync.connect(VirtualTransport(virtual))
events = board.button_events()
ctrl_c(lambda: "subscribed" in repr(events) and "not" not in repr(events))
try:
    next(events)
except KeyboardInterrupt:
    print("interrupted")
board.servo_ids()  # behind the subscription
running_thread().run(press, 3)
running_thread().run(press, 4)
print([next(events).button_id for _ in range(2)])
"""
    )
    assert run(program) == (0, "interrupted\n[3, 4]\n", "")


def test_ctrl_c_ends_connecting() -> None:
    program = (
        CTRL_C
        + """
import socket
with socket.create_server(("127.0.0.1", 0)) as server:
    received = []

    def serve():
        connection, _ = server.accept()
        with connection:
            received.append(connection.recv(1000))
            connection.recv(1000)

    threading.Thread(target=serve, daemon=True).start()
    ctrl_c(lambda: received)
    try:
        servolink.sync.connect(f"tcp://127.0.0.1:{server.getsockname()[1]}", patience=300)
    except KeyboardInterrupt:
        print("interrupted")
"""
    )
    assert run(program) == (0, "interrupted\n", "")


def test_ctrl_c_that_nobody_catches_closes_the_board(tmp_path: Path) -> None:
    state = tmp_path / "board.json"
    program = (
        CTRL_C
        + """
import sys
with servolink.sync.connect(f"virtual://?state={sys.argv[1]}") as board:
    board.write_project_id(7)
    sent = board.stats.frames_sent
    ctrl_c(lambda: board.stats.frames_sent > sent + 1)
    board.move({1: 90}, duration=300, wait=True)
"""
    )
    code, _, err = run(program, str(state))
    assert code in {-signal.SIGINT, 130}
    assert err.rstrip().endswith("KeyboardInterrupt")
    assert "Exception ignored" not in err
    assert state.exists()


@pytest.mark.parametrize("development", [[], ["-X", "dev"]])
def test_the_end_of_the_program_closes_boards_without_a_word(tmp_path: Path, development: list[str]) -> None:
    state = tmp_path / "board.json"
    program = """
import sys
import servolink.sync
board = servolink.sync.connect(f"virtual://?state={sys.argv[1]}")
other = servolink.sync.connect("virtual://", reconnect=True)
events, states = board.button_events(), other.states()
board.write_project_id(7)
print(list(events.within(0)), list(states.within(0)))
"""
    command = [sys.executable, "-W", "error", *development, "-c", program, str(state)]
    done = processes.run(command)
    assert (done.returncode, done.stdout) == (0, "[] ['connected']\n")
    assert "Error" not in done.stderr
    assert "Warning" not in done.stderr
    assert state.exists()


def test_a_board_that_does_not_close_does_not_hold_up_the_end() -> None:
    program = """
import asyncio
import servolink.sync
from servolink.sync import loop_thread
board = servolink.sync.connect("virtual://")
loop_thread._EXIT_LIMIT = 0.1
loop_thread.running_thread().at_exit.add(asyncio.Event().wait)
print("end")
"""
    assert run(program) == (0, "end\n", "")


def test_a_daemon_thread_that_waits_does_not_hold_up_the_end() -> None:
    program = """
import threading
import servolink.sync
board = servolink.sync.connect("virtual://")
events = board.button_events()
threading.Thread(target=lambda: [*events], daemon=True).start()
while "unread" not in repr(events) or "not" in repr(events):
    pass
print("end")
"""
    assert run(program) == (0, "end\n", "")


def test_calls_at_the_end_of_the_program_say_so() -> None:
    program = """
import atexit

@atexit.register
def last():
    board.close()
    try:
        board.servos()
    except RuntimeError as error:
        print(error)

import servolink.sync
board = servolink.sync.connect("virtual://")
"""
    assert run(program) == (0, "the program is ending, and all boards of servolink.sync are closed\n", "")


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="needs fork")
def test_a_forked_process_may_leave_the_blocks_of_its_parent(tmp_path: Path) -> None:
    program = f"""
import os, sys, warnings
import servolink.sync
warnings.simplefilter("ignore")  # Python warns of forks beside threads
path = {str(tmp_path / "out.mcap")!r}
with servolink.sync.connect("virtual://?servos=2") as board:
    with servolink.sync.record(path, board), board.watch(50) as readings, board.button_events() as events:
        child = os.fork()
        if not child:
            sys.exit(7)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        print([servo.servo_id for servo in next(readings).servos])
"""
    assert run(program) == (0, "7\n[1, 2]\n", "")


@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="needs fork")
def test_a_forked_process_is_told_to_connect_itself() -> None:
    program = """
import os, sys, warnings
import servolink.sync
warnings.simplefilter("ignore")  # Python warns of forks beside threads
with servolink.sync.connect("virtual://?servos=2") as board:
    child = os.fork()
    if not child:
        try:
            board.servos()
        except RuntimeError as error:
            print(error)
        with servolink.sync.connect("virtual://?servos=1") as own:
            print(own.servo_ids(), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
    print(board.servo_ids())
"""
    code, out, err = run(program)
    assert code == 0, err
    refusal, child, parent = out.splitlines()
    assert "connect in the child process" in refusal
    assert (child, parent) == ("(1,)", "(1, 2)")
