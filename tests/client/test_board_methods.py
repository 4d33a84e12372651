"""Board as a page to read: every command of the document once, in its order, described."""

from __future__ import annotations

import asyncio
import inspect
import re
import sys
from typing import Any

import pytest

import servolink
from docs.api_tables import FOLDER
from servolink import Board, connect
from servolink.protocol import PACKETS
from servolink.virtual import VirtualBoard, VirtualTransport

PUBLIC = [name for name in vars(Board) if not name.startswith("_")]
"""In the order of the source."""


def sections(name: str) -> list[str]:
    """Return the sections of the document that a method's docstring names."""
    return re.findall(r"\(?(\d\.\d\.\d+)[,)]", inspect.getdoc(getattr(Board, name)) or "")


def test_each_command_of_the_document_has_its_method() -> None:
    commands = {declared.section[:-2] for declared in PACKETS.values()}
    assert len(commands) == 32
    assert {section for name in PUBLIC for section in sections(name)} >= commands


def test_methods_stand_in_the_order_of_the_documents_chapters() -> None:
    chapters = [sections(name)[0][:3] for name in PUBLIC if sections(name)]
    assert chapters == sorted(chapters)


def test_the_class_lists_its_methods_by_chapter_as_help_sorts_them_by_name() -> None:
    listed = (inspect.getdoc(Board) or "").partition("- Connection")[2].partition("Numbers in")[0]
    assert re.findall(r"`([a-z_]+)`", listed) == PUBLIC


def test_a_board_inherits_nothing_and_describes_everything() -> None:
    assert Board.__mro__ == (Board, object)
    assert [name for name in PUBLIC if not inspect.getdoc(getattr(Board, name))] == []


def test_the_api_page_lists_every_method() -> None:
    page = (FOLDER / "board.md").read_text(encoding="utf-8")
    assert [name for name in PUBLIC if not re.search(rf"`(await )?{name}[(:]", page)] == []


# --- what a person meets in a shell -----------------------------------------------------------------------------------


async def test_a_board_shows_its_address_and_state() -> None:
    async with connect("virtual://") as board, board.button_events() as events:
        assert repr(board) == "<Board virtual:// connected>"
        assert repr(events) == "<ButtonEvents subscribed, 0 unread, 0 dropped>"
        assert repr(board.button_events()) == "<ButtonEvents not subscribed, 0 unread, 0 dropped>"
    assert repr(board) == "<Board virtual:// closed>"
    assert repr(events) == "<ButtonEvents ended, 0 unread, 0 dropped>"


@pytest.mark.parametrize("name", ["servos", "move", "url"])
def test_a_forgotten_await_is_explained(name: str) -> None:
    with pytest.raises(AttributeError, match=rf"'{name}' belongs to a connected board.*use `async with .*await"):
        getattr(connect("virtual://"), name)


def test_a_forgotten_async_is_explained() -> None:
    connecting: Any = connect("virtual://")
    with pytest.raises(TypeError, match=r"`with` alone.*async with .*servolink\.sync"), connecting:
        pass


def test_what_connect_returns_says_how_to_use_it() -> None:
    assert repr(connect("virtual://")).startswith("<connect virtual://, nothing is connected yet: use `async with ")
    assert repr(connect()).startswith("<connect, nothing is connected yet: ")
    assert repr(connect("tcp://\x1b[2J")).startswith("<connect tcp://\\x1b[2J, ")
    assert repr(connect(VirtualTransport(VirtualBoard()))).startswith("<connect virtual://, ")


@pytest.mark.skipif(sys.version_info >= (3, 14), reason="asyncio.run accepts it there, and closes its loop")
def test_asyncio_run_of_connect_is_explained() -> None:
    connecting: Any = connect("virtual://")
    with pytest.raises(ValueError, match=r"a coroutine was expected, got <connect.*use `async with "):
        asyncio.run(connecting)


def test_what_no_board_has_is_simply_missing() -> None:
    with pytest.raises(AttributeError, match="'connect' object has no attribute 'servoes'"):
        connect("virtual://").servoes  # type: ignore[attr-defined]  # noqa: B018


def test_the_package_lists_its_public_names_and_tells_its_version() -> None:
    assert set(dir(servolink)) == {*servolink.__all__, "__version__", "fleet", "hub", "recorder", "sync", "twin"}
    assert re.fullmatch(r"\d+\.\d+.*", servolink.__version__)
    assert all(hasattr(servolink, name) for name in dir(servolink))


@pytest.mark.parametrize("url", ["/dev/no-such-port", "tcp://127.0.0.1:1"])
def test_the_traceback_of_a_missing_port_is_short(url: str) -> None:
    async def main() -> None:
        with pytest.raises(servolink.OpenError) as caught:
            await connect(url)
        error: BaseException | None = caught.value.__cause__
        while error is not None:
            assert error.__traceback__ is None
            error = error.__context__

    asyncio.run(main())
