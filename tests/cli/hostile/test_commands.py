"""Every command, with hostile texts in all that it reads: what it prints is text, and it ends as with harmless ones."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.cli.index import below
from servolink.recorder import MAGIC as MCAP_MAGIC
from servolink.support import ExitCode
from tests.cli.hostile.trials import EXEMPT, TRIALS, Trial
from tests.cli.programs import Said
from tests.cli.terminals import ESCAPE, in_pipe, in_terminal
from tests.proofs.hostile.corpus import PAYLOADS, controls
from tests.proofs.hostile.world import World
from tests.sampling import sampled
from tests.virtual_time import run

PROGRESS = re.compile(r"\x1b\[([0-9;]*m|2K|1A|\?25[hl]|\?1049[hl]|H)")
"""The escapes of a bar or a picture that changes: colours, erased lines, the cursor, the other screen."""
MODES: dict[str, Callable[..., Said]] = {
    "text": in_pipe,
    "json": lambda *arguments: in_pipe("--json", *arguments),
    "terminal": in_terminal,
}


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[World, World]:
    """A harmless and a hostile world."""
    folder = tmp_path_factory.mktemp("worlds")
    harmless, hostile = World.harmless(folder / "harmless"), World.hostile(folder / "hostile")
    harmless.build()
    hostile.build()
    return harmless, hostile


@pytest.fixture(autouse=True)
def _no_board_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SERVOLINK_BOARD", "SERVOLINK_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(autouse=True)
def _in_virtual_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asyncio, "run", run)


def test_there_are_enough_of_them() -> None:
    assert len({payload.raw for payload in PAYLOADS}) > 400
    assert len({payload.family for payload in PAYLOADS}) == 20


def test_every_command_is_tried() -> None:
    assert {*TRIALS, *EXEMPT} == {*below("")}, "a command without trials: add them to tests/cli/hostile/trials.py"
    assert not TRIALS.keys() & EXEMPT.keys()
    tried = {trial.pattern.split()[1] for trial in TRIALS["project"]}
    assert tried == {*below("project")}, "a command of `servolink project` without trials"
    for command, trials in TRIALS.items():
        assert any(command in trial.pattern.split() for trial in trials)


@pytest.mark.parametrize(
    ("command", "modes"),
    [
        *sampled(((command, [[*MODES][at % 3]]) for at, command in enumerate(TRIALS)), 7),
        *(pytest.param(command, [*MODES], marks=pytest.mark.slow) for command in TRIALS),
    ],
    ids=str,
)
def test_what_is_hostile_stays_text(
    command: str, modes: list[str], built: tuple[World, World], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    harmless, hostile = built
    expected: list[Said] = []
    for mode in modes:
        if mode != "json" or not expected:  # which ends as text does
            world = harmless.copied(tmp_path / f"harmless {mode}")
            expected = [_said(world, trial, "text" if mode == "json" else mode) for trial in TRIALS[command]]
        world = hostile.copied(tmp_path / mode)
        for trial, usual in zip(TRIALS[command], expected, strict=True):
            said = _said(world, trial, mode)
            assert said.code == (ExitCode.FAILED if trial.refused else usual.code), f"{mode}: {trial}: {said}"
            _check_output(trial, mode, usual, said)
        for record in caplog.records:
            assert not controls(record.getMessage())
        for content in (path.read_bytes() for path in world.written):
            if not content.startswith(MCAP_MAGIC):  # a recording holds what passed as it was; `show` escapes it
                assert not controls(content.decode("utf-8", "surrogateescape"))


def _said(world: World, trial: Trial, mode: str) -> Said:
    with world.entered():
        return MODES[mode](*world.arguments(trial.pattern))


def _check_output(trial: Trial, mode: str, expected: Said, said: Said) -> None:
    if mode != "terminal":
        assert not controls(said.out + said.err), f"{trial}: {controls(said.out + said.err)}"
        if mode == "json":
            assert said.out.isascii(), trial
            assert all(isinstance(json.loads(line), dict) for line in _objects(trial, said.out)), trial
        return
    assert not controls(ESCAPE.sub("", said.out)) - {"\r"}, f"{trial}: {controls(ESCAPE.sub('', said.out))}"
    ours, harmless = ESCAPE.findall(said.out), ESCAPE.findall(expected.out)
    if trial.timed or trial.refused:
        assert all(map(PROGRESS.fullmatch, ours)), trial
    else:
        assert ours == harmless, trial


def _objects(trial: Trial, out: str) -> list[str]:
    return [out] if "schema" in trial.pattern else out.splitlines()
