"""`servolink virtual` as people and programs run it: a process of its own.

Module: servolink.cli.developers.virtual.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import AbstractContextManager, asynccontextmanager, nullcontext
from pathlib import Path

import pytest

from servolink.__main__ import main as servolink
from servolink.cli.developers import virtual
from servolink.protocol import (
    AddMacroRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    Codec,
    MacroEntry,
    Packet,
    QueryMacroListRequest,
    QueryMacroListResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    SubscribeButtonEventRequest,
    WriteProjectIDRequest,
)
from servolink.support import Signals
from servolink.transports import create
from servolink.virtual import BoardKind, PowerCycle, Push, StateFile, VirtualBoard, load_state
from tests import processes
from tests.cli.programs import call
from tests.virtual.receiving import GUARD, Heard, ask

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and pseudo-terminals are those of Unix")

COMMAND = (sys.executable, "-W", "error", "-m", "servolink", "virtual")
TCP = ("--tcp", "127.0.0.1:0")
Process = asyncio.subprocess.Process


LEADER = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Takes standard input as its own terminal: keys are read only by who is in the foreground of one."""


@asynccontextmanager
async def served(*options: str, terminal: int | None = None, leading: bool = True) -> AsyncIterator[Process]:
    """Run `servolink virtual`, in the foreground of `terminal` or just reading it, and see to it that it ends."""
    before = (sys.executable, "-c", LEADER) if terminal is not None and leading else ()
    stdin = terminal if terminal is not None else asyncio.subprocess.DEVNULL
    process = await processes.start_async(*before, *COMMAND, *options, stdin=stdin)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()


async def line(process: Process) -> str:
    """Return the next line that it prints."""
    assert process.stdout is not None
    async with asyncio.timeout(GUARD):
        return (await process.stdout.readline()).decode().rstrip("\n")


async def url(process: Process) -> str:
    """Return the next URL that it prints."""
    word, _, address = (await line(process)).partition(" ")
    assert word == "listening"
    return address


GONE = "ended: what the board stores is gone\n"


async def ended(process: Process, by: signal.Signals) -> tuple[int, str, str]:
    """End it and return exit code and what it said besides."""
    process.send_signal(by)
    async with asyncio.timeout(GUARD):
        out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


async def talk(address: str, *packets: Packet) -> list[Packet]:
    """Connect, ask, close."""
    transport, heard = create(address), Heard()
    await transport.open(heard)
    answers = [await ask(transport, heard, packet) for packet in packets]
    await transport.close()
    return answers


@pytest.mark.parametrize(
    "by",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_it_serves_both_kinds_until_it_is_told_to_end(by: signal.Signals) -> None:
    async def main() -> None:
        async with served("--pty", *TCP, "--servos", "3") as process:
            terminal, network = await url(process), await url(process)
            assert terminal.startswith("serial:///")
            assert network.startswith("tcp://127.0.0.1:")
            answer = [QueryServoListResponse((1, 2, 3))]
            # Two hosts at once on TCP, and one on the pseudo-terminal.
            talks = (talk(address, QueryServoListRequest()) for address in (network, network, terminal))
            assert await asyncio.gather(*talks) == [answer] * 3
            assert await ended(process, by) == (0, "", GONE)

    asyncio.run(main())


def test_it_ends_cleanly_while_hosts_are_connected() -> None:
    async def main() -> None:
        async with served(*TCP) as process:
            transport, heard = create(await url(process)), Heard()
            await transport.open(heard)
            await ask(transport, heard, QueryServoListRequest())
            assert await ended(process, signal.SIGINT) == (0, "", GONE)
            assert await heard.until_lost() is not None
            await transport.close()

    asyncio.run(main())


def test_a_pseudo_terminal_is_what_it_serves_when_nothing_is_said() -> None:
    async def main() -> None:
        async with served("--json") as process:
            assert json.loads(await line(process))["listening"].startswith("serial:///")
            assert await ended(process, signal.SIGINT) == (0, "", GONE)

    asyncio.run(main())


def test_what_is_stored_outlives_it(tmp_path: Path) -> None:
    async def main() -> None:
        options = (*TCP, "--state", str(tmp_path / "board.json"))
        async with served(*options) as process:
            await talk(await url(process), WriteProjectIDRequest(77))
            assert await ended(process, signal.SIGTERM) == (
                0,
                "",
                f"ended: what the board stores is kept in {options[-1]}\n",
            )
        async with served(*options) as process:
            assert await talk(await url(process), QueryProjectIDRequest()) == [QueryProjectIDResponse(77)]
            await ended(process, signal.SIGTERM)

    asyncio.run(main())


def test_what_is_stored_outlives_a_program_that_is_killed(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "board.json"
        async with served(*TCP, "--state", str(path)) as process:
            await talk(await url(process), WriteProjectIDRequest(77))
            async with asyncio.timeout(GUARD):
                while not path.exists():
                    await asyncio.sleep(0.01)
            process.kill()
            await process.wait()
        board = VirtualBoard()
        with StateFile(board, path):  # no lock of the dead program keeps it closed
            assert board.storage.project_id == 77
        assert list(tmp_path.iterdir()) == [path]

    asyncio.run(main())


def test_a_state_file_is_served_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    async def main() -> None:
        options = (*TCP, "--state", str(tmp_path / "board.json"))
        async with served(*options) as process:
            await url(process)
            assert servolink(["virtual", *options]) == 1
            assert "another virtual board uses this file; close the other board first" in capsys.readouterr().err
            kept = f"ended: what the board stores is kept in {options[-1]}\n"
            assert await ended(process, signal.SIGTERM) == (0, "", kept)

    asyncio.run(main())


def test_a_second_signal_does_not_keep_it_from_saving(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(file: StateFile) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        save(file)

    def start(urls: list[str], servos: int) -> AbstractContextManager[None]:
        signal.raise_signal(signal.SIGINT)
        return nullcontext()

    save = StateFile.save
    monkeypatch.setattr(StateFile, "save", interrupted)
    monkeypatch.setattr(virtual, "_announced", start)
    before = {number: signal.getsignal(number) for number in Signals.ENDING.value}
    try:
        assert servolink(["virtual", *TCP, "--state", str(tmp_path / "board.json")]) == 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert (tmp_path / "board.json").exists()


@pytest.mark.parametrize("number", Signals.ENDING.value)
def test_a_signal_that_is_ignored_at_the_start_stays_ignored(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As under `nohup`, or for a background job of a script."""
    seen: list[object] = []

    def start(urls: list[str], servos: int) -> AbstractContextManager[None]:
        seen.append(signal.getsignal(number))
        signal.raise_signal(number)
        with Signals.ENDING.handled(seen.clear):
            seen.append(signal.getsignal(number))
            signal.raise_signal(number)
        seen.append(signal.getsignal(number))
        other = next(one for one in Signals.ENDING.value if one is not number)
        signal.raise_signal(other)
        return nullcontext()

    monkeypatch.setattr(virtual, "_announced", start)
    before = {one: signal.getsignal(one) for one in Signals.ENDING.value}
    try:
        signal.signal(number, signal.SIG_IGN)
        assert servolink(["virtual", *TCP]) == 0
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert seen == [signal.SIG_IGN] * 3


def test_a_folder_that_is_read_only_is_refused_at_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(SystemExit) as ended:
        servolink(["virtual", *TCP, "--state", "board.json"])
    assert ended.value.code == 2
    assert "cannot be written; take another one" in capsys.readouterr().err


def test_adding_and_clearing_are_as_the_options_say() -> None:
    async def kept(*options: str) -> list[Packet]:
        async with served(*TCP, *options) as process:
            asked = (WriteProjectIDRequest(77), AddMacroRequest(1), AddMacroRequest(1), QueryMacroListRequest())
            answers = await talk(await url(process), *asked, ClearAllDataRequest(), QueryProjectIDRequest())
            assert await ended(process, signal.SIGINT) == (0, "", GONE)
            return [answers[3], answers[5]]

    one = MacroEntry(1, "")
    assert asyncio.run(kept()) == [QueryMacroListResponse((one,)), QueryProjectIDResponse(0)]
    appended = [QueryMacroListResponse((one, one)), QueryProjectIDResponse(77)]
    assert asyncio.run(kept("--on-duplicate", "append", "--clear", "records")) == appended


def test_a_board_that_is_unplugged_is_torn_as_the_options_say(tmp_path: Path) -> None:
    write, path = Codec().encode(WriteProjectIDRequest(77)), tmp_path / "board.json"

    async def left(*options: str) -> int:
        path.unlink(missing_ok=True)
        cut = ("--faults", f"unplug={len(write)}", "--state", str(path))
        async with served(*TCP, *cut, *options) as process:
            transport, heard = create(await url(process)), Heard()
            await transport.open(heard)
            await transport.send(write)
            assert await heard.until_lost() is not None
            await transport.close()
            await ended(process, signal.SIGINT)
        board = VirtualBoard()
        load_state(board, path)
        return board.storage.project_id

    def keeps_the_old_one(seed: int) -> bool:
        board = VirtualBoard(seed=seed, kind=BoardKind(partial_writes=True, bus_powered=True))
        session = board.attach(lambda _: None, lambda: 1)
        session.receive(write, 0.0)
        session.detach()
        return board.storage.project_id == 0

    seed = ("--seed", str(next(filter(keeps_the_old_one, range(99)))))
    assert asyncio.run(left("--partial-writes", "--bus-powered", *seed)) == 0
    assert asyncio.run(left("--bus-powered", *seed)) == 77
    assert asyncio.run(left("--partial-writes", *seed)) == 77


async def pressed(address: str, then: asyncio.Event | None, count: int) -> list[Packet]:
    """Subscribe, set `then`, and return the next `count` events."""
    transport, heard = create(address), Heard()
    await transport.open(heard)
    await ask(transport, heard, SubscribeButtonEventRequest(1))
    if then is not None:
        then.set()
    events = (await heard.until(count + 1))[1:]
    await transport.close()
    return events


def test_a_script_presses_buttons(tmp_path: Path) -> None:
    script = tmp_path / "presses"
    # Pressed again and again, as the host may come after the first of them.
    script.write_text("\n".join(f"{at / 10} press 7" for at in range(0, 600, 2)))

    async def main() -> None:
        async with served(*TCP, "--script", str(script)) as process:
            events = await pressed(await url(process), None, 4)
            assert set(events) == {
                ButtonEventResponse(7, ButtonEventResponse.PRESS),
                ButtonEventResponse(7, ButtonEventResponse.UP),
            }
            assert await ended(process, signal.SIGINT) == (0, "", GONE)

    asyncio.run(main())


def test_a_push_that_a_servo_does_not_give_way_to_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    async def pushed(board: VirtualBoard) -> None:
        virtual._apply(board, Push(1.5, 1, 40))

    board = VirtualBoard(2)
    asyncio.run(pushed(board))
    assert capsys.readouterr().err == "servolink: servo 1 is held and is not pushed at 1.5 s\n"
    board.servos[1].is_hold = 0
    asyncio.run(pushed(board))
    assert capsys.readouterr().err == ""
    assert round(board.servos[1].angle) == 40


def test_the_power_switch_puts_a_board_back_into_its_first_mode() -> None:
    async def switched(board: VirtualBoard) -> None:
        virtual._apply(board, PowerCycle(0.0))

    board = VirtualBoard(2, kind=BoardKind(mode=0))
    board.mode = 1
    asyncio.run(switched(board))
    assert (board.mode, board.powered) == (0, True)


def test_a_push_of_a_servo_that_is_not_there_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "script").write_text("1 push 3 10\n2 push 1 10\n")
    with pytest.raises(SystemExit) as ended:
        servolink(["virtual", *TCP, "--servos", "2", "--script", str(tmp_path / "script")])
    assert ended.value.code == 2
    assert "--script pushes servo 3, and the board has 2 servos" in capsys.readouterr().err


def test_keys_press_buttons_and_the_terminal_is_given_back() -> None:
    async def main() -> None:
        import termios

        ours, theirs = os.openpty()
        before = termios.tcgetattr(theirs)
        try:
            async with served(*TCP, terminal=theirs) as process:
                address = await url(process)
                subscribed = asyncio.Event()
                events = asyncio.ensure_future(pressed(address, subscribed, 5))
                await subscribed.wait()
                assert termios.tcgetattr(theirs) != before
                os.write(ours, b"3l4")
                assert await events == [
                    ButtonEventResponse(3, ButtonEventResponse.PRESS),
                    ButtonEventResponse(4, ButtonEventResponse.PRESS),
                    ButtonEventResponse(3, ButtonEventResponse.UP),
                    ButtonEventResponse(4, ButtonEventResponse.LONG_PRESS),
                    ButtonEventResponse(4, ButtonEventResponse.UP),
                ]
                code, _, said = await ended(process, signal.SIGINT)
                assert code == 0
                assert "0-9 press a button" in said
                assert termios.tcgetattr(theirs) == before
        finally:
            os.close(ours)
            os.close(theirs)

    asyncio.run(main())


def test_a_terminal_of_somebody_else_is_left_alone() -> None:
    async def main() -> None:
        import termios

        ours, theirs = os.openpty()
        before = termios.tcgetattr(theirs)
        try:
            async with served(*TCP, terminal=theirs, leading=False) as process:
                await talk(await url(process), QueryServoListRequest())
                assert termios.tcgetattr(theirs) == before
                assert await ended(process, signal.SIGINT) == (0, "", GONE)
        finally:
            os.close(ours)
            os.close(theirs)

    asyncio.run(main())


def test_it_ends_with_its_terminal() -> None:
    async def main() -> None:
        ours, theirs = os.openpty()
        async with served(*TCP, terminal=theirs) as process:
            os.close(theirs)
            await talk(await url(process), QueryServoListRequest())
            os.close(ours)
            async with asyncio.timeout(GUARD):
                _, said = await process.communicate()
            assert process.returncode == 0
            assert "Traceback" not in said.decode()

    asyncio.run(main())


@pytest.mark.parametrize(
    ("options", "code", "text"),
    [
        (("--tcp", "nowhere"), 2, "must be HOST:PORT"),
        (("--tcp", "[::1:0"), 2, "IPv6"),
        (("--servos", "255"), 2, "from 0 to 254"),
        (("--memory", "-1"), 2, "from 0 to"),
        (("--on-duplicate", "update"), 2, "append"),
        (("--clear", "most"), 2, "records"),
        (("--faults", "dorp=0.1"), 2, "'dorp' is not a fault"),
        (("--script", "missing"), 2, "missing"),
        (("--script", "/dev/zero"), 2, "is not a regular file"),
        (("--tcp", "192.0.2.1:80"), 3, "use an address of this machine"),
        (("--state", "/"), 1, "cannot be read"),
        (("--state", "/dev/zero"), 1, "is not a regular file"),
        (("--state", "missing/board.json"), 2, "missing does not exist; create it"),
    ],
)
def test_wrong_options_say_what_is_wrong(
    options: tuple[str, ...], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = call(capsys, "virtual", *options)
    assert said.code == code
    assert text in said.err
