"""Long runs count their inputs, continue where the last run ended, and report their findings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.proofs.fuzz import __main__, campaign
from tests.proofs.fuzz.campaign import Campaign, Count
from tests.proofs.fuzz.rounds import mutated
from tests.proofs.fuzz.targets import TARGETS


def fragile(data: bytes) -> None:
    if data.startswith(b"\xff"):
        raise ValueError("it does not hold")


@pytest.fixture(autouse=True)
def _quick_targets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "GUIDED", False)
    monkeypatch.setattr(campaign, "_TURN", 0.01)
    for name, target in TARGETS.items():
        monkeypatch.setitem(TARGETS, name, replace(target, check=lambda data: None))


def test_counts_are_added_to_those_of_earlier_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "GOAL", 5000)
    before = Campaign.of({"counts": {"parse": {"mutated": 1000, "guided": 10}}, "seed": 7})
    for _ in before.rounds(1000.0, tmp_path):
        pass
    assert before.counts["parse"].mutated > 1000
    assert before.counts["parse"].guided == 10
    after = Campaign.of(json.loads(json.dumps(before.result())))
    assert (after.counts, after.seed) == (before.counts, before.seed)
    assert after.inputs == before.inputs >= 5000


def test_a_run_ends_when_enough_inputs_were_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "GOAL", 100)
    run = Campaign({name: Count(mutated=9) for name in TARGETS})
    for _ in run.rounds(1000.0, tmp_path):
        pass
    assert 100 <= run.inputs < 1_000_000, run


def test_a_finding_is_told_with_its_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(TARGETS, "parse", replace(TARGETS["parse"], check=fragile))
    finding = mutated("parse", 60.0, seed=1).finding
    assert finding.startswith("ff")
    assert finding.endswith("ValueError: it does not hold\n")
    output = tmp_path / "figures.json"
    monkeypatch.setattr(campaign, "GOAL", 5000)
    monkeypatch.setattr("sys.argv", ["fuzz", "--minutes", "1", "--output", str(output)])
    assert __main__.main() == 1
    assert json.loads(output.read_text())["fuzz"]["wrong"] == ["parse: ValueError: it does not hold"]


def test_the_short_run_tries_every_target() -> None:
    result = campaign.run(short=True)
    assert result["inputs"] > 1000
    assert result["wrong"] == []
    assert [table["columns"][0] for table in result["tables"]] == ["bytes taken for", "bytes taken for"]
