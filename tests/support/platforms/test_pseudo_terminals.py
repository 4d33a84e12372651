"""A pseudo-terminal that programs open and close, as Linux has it and as macOS says it."""

from __future__ import annotations

import asyncio
import os
import select
import sys
import termios
from collections.abc import Coroutine
from types import SimpleNamespace
from typing import Any

import pytest

from servolink.errors import TransportUnavailable
from servolink.support.platforms.pseudo_terminals import PseudoTerminal

if sys.platform == "win32":
    pytest.skip("pseudo-terminals are those of Unix", allow_module_level=True)


def on_terminal(use: Any) -> None:
    """Run something with a new terminal."""

    async def main() -> None:
        terminal = PseudoTerminal()
        try:
            done = use(terminal)
            if isinstance(done, Coroutine):
                await done
        finally:
            terminal.close()

    asyncio.run(main())


def opened(terminal: PseudoTerminal) -> int:
    """Open the terminal as a program does."""
    return os.open(terminal.name, os.O_RDWR | os.O_NOCTTY)


def test_a_terminal_is_closed_until_a_program_opens_it_and_when_it_has_gone() -> None:
    def use(terminal: PseudoTerminal) -> None:
        for _ in range(2):
            assert (terminal.read(), terminal.is_closed()) == (None, True)
            assert terminal.write(b"nobody") in {0, 6}
            terminal.renew()
            program = opened(terminal)
            assert (terminal.read(), terminal.is_closed()) == (b"", False)
            os.write(program, b"\x03\r\n")
            assert terminal.read() == b"\x03\r\n", "no byte is changed"
            os.write(program, b"last")
            os.close(program)
            assert terminal.is_closed(), "though something can still be read"
            assert terminal.read() == b"last"

    on_terminal(use)


def test_a_new_program_finds_no_settings_and_no_bytes_of_the_last_one() -> None:
    def use(terminal: PseudoTerminal) -> None:
        program = opened(terminal)
        settings = termios.tcgetattr(program)
        settings[3] |= termios.ECHO | termios.ICANON
        settings[4] = settings[5] = termios.B9600
        termios.tcsetattr(program, termios.TCSANOW, settings)
        assert terminal.baudrate() == 9600
        assert terminal.write(b"unread\n") == 7
        os.close(program)
        terminal.renew(57_600)
        assert terminal.baudrate() == 57_600
        program = opened(terminal)
        assert not termios.tcgetattr(program)[3] & (termios.ECHO | termios.ICANON)
        assert select.select([program], [], [], 0)[0] == []
        os.close(program)

    on_terminal(use)


def test_the_loop_says_when_bytes_come_and_when_there_is_room() -> None:
    async def use(terminal: PseudoTerminal) -> None:
        program = opened(terminal)
        os.write(program, b"x")
        for listen in (terminal.on_readable, terminal.on_writable):
            told = asyncio.Event()
            listen(told.set)
            await told.wait()
            listen(None)
        assert terminal.read() == b"x"
        assert terminal.write(b"y") == 1
        assert os.read(program, 2) == b"y"
        os.close(program)

    on_terminal(use)


def test_macos_reads_nothing_from_a_closed_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    def use(terminal: PseudoTerminal) -> None:
        monkeypatch.setattr(os, "read", lambda *_: b"")
        assert terminal.read() is None

    on_terminal(use)


@pytest.mark.parametrize("is_closed", [True, False])
def test_macos_is_asked_through_a_kernel_queue(is_closed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """As its manual says: its poll supports no devices."""
    eof = 0x8000
    found = [SimpleNamespace(flags=eof if is_closed else 0)]
    asked: list[object] = []

    class Queue:
        def control(self, changes: list[object], most: int, seconds: float) -> list[SimpleNamespace]:
            asked.extend([*changes, most, seconds])
            return found

        def close(self) -> None:
            asked.append("closed")

    def use(terminal: PseudoTerminal) -> None:
        monkeypatch.setattr(sys, "platform", "darwin")
        for name, value in (
            ("kqueue", Queue),
            ("kevent", lambda *event: event[1:]),
            ("KQ_FILTER_READ", -1),
            ("KQ_EV_ADD", 1),
            ("KQ_EV_EOF", eof),
        ):
            monkeypatch.setattr(select, name, value, raising=False)
        assert terminal.is_closed() is is_closed
        assert asked == [(-1, 1), 1, 0, "closed"]
        monkeypatch.undo()

    on_terminal(use)


@pytest.mark.parametrize("system", ["win32", "emscripten"])
def test_windows_and_pyodide_have_none(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", system)
    with pytest.raises(TransportUnavailable, match="this system has no pseudo-terminals; use TCP"):
        PseudoTerminal.open_pair()
