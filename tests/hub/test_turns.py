"""Work that a program asks of a hub leaves the event loop free, so that a stop of another program comes through.

Module: servolink.support.tasks.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from servolink.project import Project, ProjectFile
from servolink.protocol import Action, Macro, MacroCommand, MacroCommandType, Step
from servolink.testing import VirtualTimeLoop
from servolink.virtual import BoardKind
from tests.hub.control_program import RpcFailed, shared

RECORDS = 150
MOST_CALLS = 40 * RECORDS
"""Calls of functions in one turn of the event loop: a list of all records may pass, a check of all may not."""


@contextmanager
def counted_turns(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Yield a list that gets the number of calls in each turn of the event loop, without those in threads."""
    turns = [0]
    run_handle, run_in_executor = asyncio.Handle._run, VirtualTimeLoop.run_in_executor

    def count(_frame: Any, event: str, _argument: Any) -> None:
        turns[-1] += event == "call"

    def run(handle: asyncio.Handle) -> None:
        turns.append(0)
        run_handle(handle)

    def elsewhere(loop: VirtualTimeLoop, executor: Any, work: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:
        sys.setprofile(None)
        try:
            return run_in_executor(loop, executor, work, *args)
        finally:
            sys.setprofile(count)

    monkeypatch.setattr(asyncio.Handle, "_run", run)
    monkeypatch.setattr(VirtualTimeLoop, "run_in_executor", elsewhere)
    sys.setprofile(count)
    try:
        yield turns
    finally:
        sys.setprofile(None)


async def test_large_requests_leave_the_event_loop_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    steps = tuple(Step(servo_id, 5, 10) for servo_id in range(20))
    play = MacroCommandType.ACTION
    every = tuple(MacroCommand(number, play, 100, 1, 100) for number in range(1, RECORDS + 1))
    project = Project(
        actions=tuple(Action(number, f"\u00e9{number}", steps) for number in range(1, RECORDS + 1)),
        macros=(Macro(1, "all", every),),
    )
    form = ProjectFile(project).form()
    async with shared(kind=BoardKind(memory=10**6)) as here, here.program("script") as script:
        with counted_turns(monkeypatch) as turns:
            await script.call("project.apply", project=form)
            assert (await script.call("project.plan", project=form))["changes"] == []
            assert await script.call("project.export") == {"project": form}
            await script.call("records.put", type="action", record={"action_id": 7})
            await script.call("run", type="macro", id=1, wait=False, dry_run=True)
            await script.call("project.rollback")
            for method, params in (
                ("move", {"targets": dict.fromkeys(map(str, range(10_000)), 1), "duration": 1}),
                ("stream.begin", {"limits": [{"angles": {"1": [0, 90]}}] * 10_000}),
            ):
                with pytest.raises(RpcFailed, match="has 10000 items; at most"):
                    await script.call(method, **params)
        assert len(turns) > RECORDS
        assert max(turns) < MOST_CALLS
