"""Keys of a Windows console, with a `msvcrt` of ours: `servolink.support.platforms.keyboard` as Windows imports it."""

from __future__ import annotations

import asyncio
import importlib.util
import signal
import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from servolink.support.platforms import keyboard
from tests.virtual_time import run


class Console:
    """What `msvcrt` has for keys: it gives one half of a key at a time, and cannot wait."""

    def __init__(self, keys: str = "") -> None:
        self.keys = keys
        self.is_gone = False
        self.looks = 0

    def kbhit(self) -> bool:
        self.looks += 1
        if self.is_gone:
            raise OSError(6, "The handle is invalid")
        return bool(self.keys)

    def getwch(self) -> str:
        key, self.keys = self.keys[0], self.keys[1:]
        return key


class Stuck(Console):
    """A key that is held down, and repeated faster than anybody reads."""

    def kbhit(self) -> bool:
        self.looks += 1
        return True

    def getwch(self) -> str:
        return "x"


@pytest.fixture
def on_windows(monkeypatch: pytest.MonkeyPatch) -> Callable[[Console], ModuleType]:
    """Return a function that imports the module as Windows does, with a console."""

    def load(console: Console) -> ModuleType:
        monkeypatch.setattr(sys, "platform", "win32")
        monkeypatch.setitem(sys.modules, "msvcrt", console)
        monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
        spec = importlib.util.spec_from_file_location("keyboard_of_windows", keyboard.__file__)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


def typed_within(seconds: float, module: ModuleType, act: Callable[[], object] = lambda: None) -> list[str]:
    """Return the texts of keys in some seconds, after half of which something is done."""
    texts: list[str] = []

    async def listen() -> None:
        end = module.begin_keys(texts.append)
        assert end is not None
        await asyncio.sleep(seconds / 2)
        act()
        await asyncio.sleep(seconds / 2)
        end()
        await asyncio.sleep(seconds)

    run(listen())
    return texts


def test_keys_are_those_that_a_terminal_types(on_windows: Callable[[Console], Any]) -> None:
    module = on_windows(Console("a \r\x1b\t\xe0H\xe0P\x00K\xe0M\xe0s\xe0t\x00;\xe0G+"))
    (text,) = typed_within(1, module)
    assert text == "a \r\x1b\t\x1b[A\x1b[B\x1b[D\x1b[C\x1b[1;2D\x1b[1;2C+"


def test_a_letter_that_looks_like_half_a_key_is_a_letter(on_windows: Callable[[Console], Any]) -> None:
    assert typed_within(1, on_windows(Console("\xe0"))) == ["\xe0"]


def test_keys_come_as_long_as_somebody_listens(on_windows: Callable[[Console], Any]) -> None:
    console = Console()
    module = on_windows(console)
    assert typed_within(1, module, lambda: setattr(console, "keys", "q")) == ["q"]
    looks = console.looks
    console.keys = "q"
    assert 45 <= looks <= 60, "not busily"
    assert console.looks == looks
    assert console.keys == "q", "the next program gets it"


def test_a_console_that_is_gone_is_told_once(on_windows: Callable[[Console], Any]) -> None:
    console = Console()
    module = on_windows(console)
    texts = typed_within(1, module, lambda: setattr(console, "is_gone", True))
    assert texts == [""]


def test_a_key_that_never_ends_leaves_the_loop_time(on_windows: Callable[[Console], Any]) -> None:
    texts = typed_within(1, on_windows(Stuck()))
    assert {len(text) for text in texts} == {64}
    assert len(texts) <= 60


def test_an_interrupt_that_is_read_as_a_key_is_a_signal(on_windows: Callable[[Console], Any]) -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        assert typed_within(1, on_windows(Console("a\x03b"))) == ["ab"]
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIGINT]


def test_input_that_is_no_console_has_no_keys(
    on_windows: Callable[[Console], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = on_windows(Console("q"))
    for stdin in (None, SimpleNamespace(isatty=lambda: False)):
        monkeypatch.setattr(sys, "stdin", stdin)
        assert module.begin_keys(print) is None
