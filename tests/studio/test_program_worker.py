"""A program of a person: its output comes in few messages, and an error is told with its line.

Module: servolink.studio.program_worker.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

import pytest

from servolink.control import ShareTransport
from servolink.studio.program_worker import ProgramWorker, perform
from tests.support.page_pipes import HAS_SOCKETS


async def test_run_awaits_outside_of_functions_where_nothing_could_wait(capsys: pytest.CaptureFixture[str]) -> None:
    source = """
import asyncio
async def main():
    await asyncio.sleep(0.01)
    return 7
if __name__ == "__main__":
    print(asyncio.run(main()))
await asyncio.sleep(0.01)
print("top")
"""
    assert await perform(source) is None
    assert capsys.readouterr().out == "7\ntop\n"


@pytest.mark.parametrize(
    ("source", "kind", "line"),
    [
        ("x = 1\nprint(y)\n", "NameError", 2),
        ("def f():\n    return 1 / 0\n\nf()\n", "ZeroDivisionError", 2),
        ("print('a'\n", "SyntaxError", 1),
        ("if True:\nprint(1)\n", "IndentationError", 2),
        ("import json\n\njson.loads('{')\n", "JSONDecodeError", 3),
        ("import sys\nsys.exit('no robot')\n", "SystemExit", 2),
        ("raise ExceptionGroup('two', [KeyError('a'), ValueError()])\n", "KeyError", 0),
        ("import asyncio\n\ndef f():\n    asyncio.run(g())\nasync def g(): pass\nf()\n", "RuntimeError", 4),
        ("import asyncio\nraise asyncio.CancelledError\n", "CancelledError", 2),
    ],
)
@pytest.mark.filterwarnings("ignore:coroutine 'g' was never awaited")
async def test_an_error_is_told_with_its_line(source: str, kind: str, line: int) -> None:
    failure = await perform(source)
    assert failure is not None
    assert (failure.kind, failure.line) == (kind, line)
    assert failure.trace.rstrip().splitlines()[-1].startswith(kind) or kind in failure.trace
    assert "program_worker.py" not in failure.trace


async def test_an_orderly_exit_is_no_error() -> None:
    assert await perform("raise SystemExit") is None
    assert await perform("import sys\nsys.exit(0)") is None


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> list[tuple[str, str]]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(HAS_SOCKETS, False)
    for name in ("argv", "stdout", "stderr"):
        monkeypatch.setattr(f"sys.{name}", getattr(sys, name))
    monkeypatch.setattr(ShareTransport, "dead_man", None)
    return []


async def run(source: str, told: list[tuple[str, str]]) -> None:
    program = ProgramWorker(lambda *message: told.append(message), lambda *message: None)
    program.hear("hub", 0, "virtual")
    await program.run(source)


async def test_a_program_that_prints_much_sends_few_messages(told: list[tuple[str, str]]) -> None:
    await run("for number in range(50_000): print(number)\n", told)
    outputs = [text for kind, text in told if kind == "output"]
    assert len(outputs) < 200
    assert outputs[0] == "0"
    assert outputs[-1].endswith("49999\n")
    assert all(len(text) < 20_000 for text in outputs)
    assert told[-1] == ("ended", "")


async def test_what_is_printed_comes_while_the_program_waits(told: list[tuple[str, str]]) -> None:
    running = asyncio.ensure_future(run("import asyncio\nprint('a')\nprint('b')\nawait asyncio.sleep(60)\n", told))
    await asyncio.sleep(1)
    assert "".join(text for _, text in told) == "a\nb\n"
    running.cancel()
    await running
    assert json.loads(told[-1][1])["kind"] == "CancelledError"
