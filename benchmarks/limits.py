"""docs/limits.md: the words of benchmarks/limits.md with the published figures in them, and none by hand."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.report import FIGURES, ROOT
from tests.proofs.reliability.line import LINES

PAGE = ROOT / "docs/limits.md"
_WORDS = ROOT / "benchmarks/limits.md"
_COUNTED_IN_IMPORTS = ("lost", "wrong after applying", "wrong after rolling back")


def write() -> None:
    """Write the page."""
    PAGE.write_text(page(FIGURES), encoding="utf-8")


def page(figures: Path) -> str:
    """Return the page for the JSON files in `figures`; Markdown."""
    parts = _read(figures / "reliability.json")["reliability"]["parts"]
    found = {name: part["figures"] for name, part in parts.items()}
    return _WORDS.read_text(encoding="utf-8").format(
        **_conversations(found["simulation"]),
        **_weaknesses(found["sums"], found["hidden"], found["reopening"]),
        **_strengths(found),
        **_sharing(found["hub"]),
        **_imports(_read(figures / "imports.json")["imports"]["counts"]),
        **_lucky(_read(figures / "recall.json")["recall"]["lucky"]),
        **_fleet(_read(figures / "fleet.json")),
    )


def _read(path: Path) -> dict[str, Any]:
    read: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return read


def _lucky(recall: dict[str, int]) -> dict[str, str]:
    """Return what is found where every damaged frame has the right sum."""
    return {"lucky_intact": f"{recall['intact']:,}", "lucky_missed": f"{recall['intact'] - recall['found']:,}"}


def _fleet(record: dict[str, Any]) -> dict[str, str]:
    """Return how soon the boards of the largest fleet started and stopped, in ms."""
    case = max(record["fleet"]["cases"], key=lambda case: case["boards"])
    found = {"fleet_boards": str(case["boards"]), "fleet_cores": str(record["machine"]["cores"])}
    for name in ("start", "stop"):
        ordered = sorted(case["spreads" if name == "start" else "stops"])
        found[f"{name}_median"] = f"{1000 * ordered[len(ordered) // 2]:.0f}"
        found[f"{name}_most"] = f"{1000 * ordered[len(ordered) * 99 // 100]:.0f}"
    return found


def _conversations(found: dict[str, Any]) -> dict[str, str]:
    """Return what the simulated conversations say."""
    total, repeating = Counter(found["total"]), Counter(found["repeating"])
    lossy = Counter(found["boards"]["lossy 1 %, slow 3 %"])
    per_million = {name: _share(counts.get("damage accepted", 0), counts["right"]) for name, counts in _damaging(found)}
    numbers = {
        "calls": total["calls"],
        "histories": found["histories"],
        "cancelled": total["cancelled"],
        "wrong": total["wrong"],
        "once": total["motion and clearing"],
        "twice": total["executed twice"],
        "faults": found["faults"],
        "damaged_commands": total["damaged commands executed"],
        "sendings": total["sendings"],
        "repeated": repeating["of a repeated answer"],
        "repeating_calls": repeating["calls"],
        "commands_lost": lossy["commands sent"] - lossy["commands executed"],
        "commands_sent": lossy["commands sent"],
        "unknown": lossy["outcome unknown"],
        "unknown_done": lossy["unknown and done"],
        "lossy_calls": lossy["calls"],
    }
    return {
        "believed": _table(("line", "wrong responses per million"), list(per_million.items())),
        **{name: f"{number:,}" for name, number in numbers.items()},
    }


def _damaging(found: dict[str, Any]) -> list[tuple[str, dict[str, int]]]:
    undamaged = {line.name for line in LINES if not line.damages}
    return [(name, counts) for name, counts in found["lines"].items() if name not in undamaged]


def _weaknesses(sums: dict[str, Any], hidden: dict[str, Any], reopening: dict[str, Any]) -> dict[str, str]:
    """Return what the studies of single weaknesses say."""
    believed: dict[str, dict[str, str]] = {}
    for name, counts in sums["believed"].items():
        damage, _, size = name.rpartition(", ")
        believed.setdefault(damage, {})[size] = " → ".join(_share(count, sums["count"]) for count in counts)
    first = next(iter(believed.values()))
    heard = next(iter(hidden.values()))
    few = [counts for name, counts in reopening.items() if name.startswith("1 to 5")]
    many = [counts for name, counts in reopening.items() if name.startswith(("8,", "16,", "32,"))]
    return {
        "sums": _table(("damage", *first), [(damage, *cells.values()) for damage, cells in believed.items()]),
        "hidden": _table(
            ("line", "frames found in captions", "got through"),
            [(name, f"{counts['came out']:,}", f"{counts['got through']:,}") for name, counts in hidden.items()],
        ),
        "hidden_missed": f"{sum(counts['intact'] - counts['found'] for counts in hidden.values()):,}",
        "hidden_intact": f"{sum(counts['intact'] for counts in hidden.values()):,}",
        "hidden_frames": f"{heard['intact'] + heard['damaged']:,}",
        "few_openings": f"{sum(counts['openings'] for counts in few):,}",
        "few_wrong": f"{sum(counts.get('wrong openings', 0) for counts in few):,}",
        "many_openings": f"{sum(counts['openings'] for counts in many):,}",
        "many_wrong": f"{sum(counts.get('wrong openings', 0) for counts in many):,}",
    }


def _strengths(figures: dict[str, Any]) -> dict[str, str]:
    """Return what the other studies say."""
    framing, stalls, flood = figures["framing"].values(), figures["stalls"], figures["flood"]
    real, virtual = figures["soak"], figures["soak, virtual"]
    lost = list(stalls["lost"].values())
    return {
        "intact": f"{sum(line['intact'] for line in framing):,}",
        "not_found": f"{sum(line['intact'] - line['found'] for line in framing):,}",
        "stalls": f"{stalls['count'] * len(lost):,}",
        "stalls_lost": f"{sum(ours for _, _, ours in lost):,}",
        "pythons": ", ".join(sorted({name.partition(",")[0].rpartition(".")[0] for name in stalls["lost"]})),
        "events": f"{flood['events']:,}",
        "dropped": f"{flood['dropped']:,}",
        "flood_growth": f"{flood['growth'] / 1e6:.1f} MB",
        "longest": f"{virtual['hours']:g} hours of virtual and {real['hours']:g} hours of real time",
        "soaks": "\n".join(
            f"| {soak['hours']:g} h of use in {where} with 1 % faults: descriptors, threads, tasks "
            f"| {soak['calls']:,} calls, {soak['connections']:,} connections "
            f"| all as before; {soak['growth'] / 1e6:+.1f} MB of memory |"
            for where, soak in (("virtual time", virtual), ("real time over a pseudo-terminal", real))
        ),
    }


def _sharing(found: dict[str, Any]) -> dict[str, str]:
    """Return what the programs that share a board say."""
    total = Counter(found["total"])
    numbers = {
        "hub_requests": total["requests"],
        "hub_killed": total["killed"],
        "hub_pulled": total["pulled"],
        "hub_wrong": total["wrong"] + total["stale"],
        "hub_twice": total["executed twice"],
        "hub_hung": total["hung"],
    }
    return {name: f"{number:,}" for name, number in numbers.items()}


def _imports(counts: dict[str, Counter[str]]) -> dict[str, str]:
    """Return what the pulled imports say."""
    total: Counter[str] = Counter()
    for count in counts.values():
        total.update(count)
    wrong = sum(total[name] for name in _COUNTED_IN_IMPORTS)
    return {"pulls": f"{total['pulls']:,}", "imports_wrong": f"{wrong:,}"}


def _share(count: int, of: int) -> str:
    """Return a count per million, exact to one in a million."""
    return f"{count / of * 1e6:,.0f}"


def _table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    head = [columns, tuple("---" for _ in columns)]
    return "\n".join(f"| {' | '.join(row)} |" for row in [*head, *rows])
