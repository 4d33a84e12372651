"""Charts as SVG files that can be read on a light and on a dark page."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.charts import Chart, number

# Each colour of the light scheme and the one that takes its place in the dark scheme.
_PAPER, _INK, _FAINT = ("#fdfdfe", "#15181d"), ("#24292f", "#e2e7ec"), ("#d6dae0", "#3a414a")
_OURS, _OTHERS = ("#0f62c9", "#4c9bff"), ("#a2abb6", "#6f7986")
_SERIES = [("#9aa5b1", "#717c89"), ("#d08a1d", "#e5a53f"), _OURS]

_STYLE = {
    "svg.fonttype": "none",  # text stays text: it can be searched and read aloud, and the file is small
    "svg.hashsalt": "servolink",  # the same identifiers in each run
    "font.family": "DejaVu Sans",  # comes with matplotlib, so the layout is the same on all machines
    "font.size": 9.5,
    "text.color": _INK[0],
    "axes.edgecolor": _FAINT[0],
    "axes.labelcolor": _INK[0],
    "xtick.color": _INK[0],
    "ytick.color": _INK[0],
    "grid.color": _FAINT[0],
    "figure.facecolor": _PAPER[0],
    "axes.facecolor": _PAPER[0],
}


def write(folder: Path, charts: list[Chart]) -> None:
    """Write each chart to `folder`, and delete the files of charts that are gone."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.svg"):
        if old.stem not in {chart.name for chart in charts}:
            old.unlink()
    for chart in charts:
        (folder / f"{chart.name}.svg").write_text(svg(chart), encoding="utf-8")


def svg(chart: Chart) -> str:
    """Return a chart as SVG, the same text for the same chart."""
    with mpl.rc_context(_STYLE):
        figure, axes = _bars(chart)
        figure.suptitle(chart.title, x=0.02, ha="left", weight="bold", size=11.5)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
        axes.tick_params(length=0)
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Title": chart.title})
    return drawn.getvalue().replace("</svg>", f"{_dark()}</svg>")


def _dark() -> str:
    """Return the style that puts the colours of the dark scheme in place of those of the light one."""
    pairs = {_PAPER, _INK, _FAINT, _OURS, _OTHERS, *_SERIES}
    rules = [
        f'[style*="{what}: {light}"]{{{what}:{dark} !important}}'
        for light, dark in sorted(pairs)
        for what in ("fill", "stroke")
    ]
    return f"<style>@media (prefers-color-scheme: dark){{{''.join(rules)}}}</style>\n"


def _bars(chart: Chart) -> tuple[Figure, Axes]:
    """Draw a group of horizontal bars for each label, the first on top."""
    count = len(chart.series)
    height = 1.15 + len(chart.labels) * (0.1 + 0.19 * count)
    figure = Figure(figsize=(7.2, height), layout="constrained")
    axes = figure.add_subplot()
    thickness = 0.8 / count
    for place, (name, cells) in enumerate(chart.series.items()):
        values = [number(cell) or 0 for cell in cells]
        at = [row + (place - (count - 1) / 2) * thickness for row in range(len(values))]
        drawn = axes.barh(at, values, thickness * 0.92, color=_bar_colours(chart, place), label=name)
        axes.bar_label(drawn, labels=cells, padding=4, size=8.5)
    axes.set_yticks(range(len(chart.labels)), chart.labels)
    for label in axes.get_yticklabels():
        label.set_fontweight("bold" if "servolink" in label.get_text() else "normal")
    axes.invert_yaxis()
    if chart.is_log:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.margins(x=0.16, y=0.02)
    axes.set_xlabel(chart.axis)
    axes.grid(visible=True, axis="x")
    axes.set_axisbelow(True)
    if count > 1:
        _legend(figure, count)
    return figure, axes


def _bar_colours(chart: Chart, place: int) -> Any:
    if len(chart.series) > 1:
        return (_SERIES[-2:] if len(chart.series) == 2 else _SERIES)[place][0]
    return [(_OURS if "servolink" in label else _OTHERS)[0] for label in chart.labels]


def _legend(figure: Figure, count: int) -> None:
    figure.legend(loc="outside lower left", ncols=count, frameon=False, handlelength=1, handleheight=0.8)
