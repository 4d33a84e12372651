"""The page of limits is what the published figures give, and no figure was written into it by hand."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from benchmarks import limits
from benchmarks.report import FIGURES

PAGE = limits.PAGE.read_text(encoding="utf-8")
RECORD = json.loads((FIGURES / "reliability.json").read_text(encoding="utf-8"))
PARTS = RECORD["reliability"]["parts"]


def test_the_page_is_made_from_the_figures() -> None:
    assert limits.page(FIGURES) == PAGE, "run `python -m benchmarks --report`"


def test_a_fault_that_was_found_would_stand_on_the_page(tmp_path: Path) -> None:
    for name in ("fleet.json", "imports.json", "recall.json"):
        shutil.copy(FIGURES / name, tmp_path)
    record = json.loads(json.dumps(RECORD))
    record["reliability"]["parts"]["simulation"]["figures"]["total"]["wrong"] = 4321
    (tmp_path / "reliability.json").write_text(json.dumps(record), encoding="utf-8")
    assert "4,321" in limits.page(tmp_path)
    assert "4,321" not in PAGE


def test_the_figures_are_those_of_long_runs() -> None:
    simulation = PARTS["simulation"]["figures"]
    assert simulation["total"]["calls"] >= 10_000_000
    assert simulation["total"]["motion and clearing"] >= 300_000
    assert PARTS["sums"]["figures"]["count"] >= 1_000_000
    assert PARTS["flood"]["figures"]["events"] >= 10_000_000
    assert PARTS["stalls"]["figures"]["count"] >= 10_000
    assert len({name.partition(",")[0] for name in PARTS["stalls"]["figures"]["lost"]}) >= 3
    assert PARTS["soak, virtual"]["figures"]["hours"] >= 2
    assert PARTS["hub"]["figures"]["total"]["requests"] >= 800_000  # without those of the board that responds twice


def test_nothing_that_must_not_be_is_published_as_a_strength() -> None:
    assert [fault for part in PARTS.values() for fault in part["wrong"]] == []


def test_every_limit_says_what_to_do() -> None:
    sections = re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]
    assert len([section for section in sections if "What to do" in section]) >= 6
