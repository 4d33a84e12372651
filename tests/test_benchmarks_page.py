"""The page of figures is what the committed figures give, and nothing was written into it by hand."""

from __future__ import annotations

import html
import importlib.util
import json
import re
from pathlib import Path

import pytest

from benchmarks import BENCHMARKS, CAMPAIGNS, report
from benchmarks.charts import Chart, charts, number
from benchmarks.goals import at_least, at_most
from benchmarks.measuring import table
from tests.tables import over

MACHINE = {"python": "CPython 3.11.7", "processor": "Fast", "cores": 2, "system": "Linux 6.1", "date": "2026-01-02"}


def page(folder: Path, **results: object) -> str:
    (folder / "run.json").write_text(json.dumps({"machine": MACHINE, **results}), encoding="utf-8")
    return report.page(folder)


def test_the_page_is_made_from_the_figures() -> None:
    remedy = "run `python -m benchmarks --report`"
    assert report.PAGE.read_text(encoding="utf-8") == report.page(report.FIGURES), remedy


def test_there_is_a_picture_for_each_chart_and_no_other() -> None:
    names = [chart.name for chart in report.all_charts(report.FIGURES)]
    assert sorted(names) == sorted(path.stem for path in report.PICTURES.iterdir())


@pytest.mark.parametrize("chart", report.all_charts(report.FIGURES), ids=lambda chart: chart.name)
def test_a_picture_shows_the_figures_of_its_chart(chart: Chart) -> None:
    svg = (report.PICTURES / f"{chart.name}.svg").read_text(encoding="utf-8")
    quote = {html.unescape(text) for text in re.findall(r"<text[^>]*>([^<]*)</text>", svg)}
    cells = [cell for cells in chart.series.values() for cell in cells]
    names = chart.series if len(chart.series) > 1 else ()
    missing = {chart.title, chart.axis, *chart.labels, *names, *cells} - quote
    assert not missing, "run `python -m benchmarks --report`"


@pytest.mark.slow
@pytest.mark.parametrize("chart", report.all_charts(report.FIGURES), ids=lambda chart: chart.name)
def test_a_picture_is_what_is_drawn_of_its_chart(chart: Chart) -> None:
    pytest.importorskip("matplotlib", reason="in the extra docs")
    from benchmarks import plots

    assert (report.PICTURES / f"{chart.name}.svg").read_text(encoding="utf-8") == plots.svg(chart)


@pytest.mark.parametrize(
    ("cell", "value"), [("5,045,692", 5045692), ("+27.0", 27), ("-1.5", -1.5), ("99.9%", 99.9), ("3 of 1,000", 0.3)]
)
def test_a_cell_of_a_table_is_read_as_a_number(cell: str, value: float) -> None:
    assert number(cell) == pytest.approx(value)


def test_a_cell_without_a_value_has_no_number() -> None:
    assert number("-") is None
    assert charts("parser", {"tables": []}) == []


@over("module", [*(benchmark.module for benchmark in BENCHMARKS.values()), *CAMPAIGNS.values()])
def test_every_benchmark_has_its_module(module: str) -> None:
    assert importlib.util.find_spec(module)


@over("path", sorted(report.FIGURES.glob("*.json")))
def test_all_committed_figures_are_on_a_page(path: Path) -> None:
    assert set(json.loads(path.read_text(encoding="utf-8"))) - {"machine"} <= BENCHMARKS.keys() | CAMPAIGNS.keys()


def test_a_section_tells_command_machine_and_versions(tmp_path: Path) -> None:
    text = page(tmp_path, parser={"versions": {"pymodbus": "3.1"}})
    where = "CPython 3.11.7, Fast, 2 cores, Linux 6.1; 2026-01-02"
    assert f"\n\n`python -m benchmarks parser`: {where}; with pymodbus 3.1.\n" in text


def test_a_table_has_numbers_on_the_right_and_its_notes_below(tmp_path: Path) -> None:
    quote = table("speed", ("name", "times"), [("a|b", "2.5x"), ("c", "<= 3")], ["as a note"])
    text = page(tmp_path, parser={"tables": [quote]})
    assert "speed:\n\n| name | times |\n| --- | ---: |\n| a\\|b | 2.5x |\n| c | <= 3 |\n\n* as a note\n" in text


def test_all_goals_and_faults_are_at_the_top_of_the_page(tmp_path: Path) -> None:
    goals = [at_most("cost", 3, 2), at_least("speed", 3, 2)]
    text = page(tmp_path, parser={"goals": goals}, peers={"wrong": ["one lost"]})
    top, _, sections = text.partition("## The parser")
    assert "1 of 2 goals are met.\n" in top
    assert "| [parser](#the-parser-against-a-textbook-parser) | cost | at most 2.00x | 3.00x | **missed** |\n" in top
    assert "| [parser](#the-parser-against-a-textbook-parser) | speed | at least 2.00x | 3.00x | met |\n" in top
    assert "| one lost | none |  | **wrong** |\n" in top
    assert "* one lost\n" in sections


def test_goals_are_few_enough_to_be_read() -> None:
    figures = [json.loads((report.FIGURES / f"{name}.json").read_text(encoding="utf-8"))[name] for name in BENCHMARKS]
    assert sum(len(each.get("goals", [])) for each in figures) <= 45
