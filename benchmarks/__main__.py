"""`python -m benchmarks [NAME ...]` measures; `--publish` measures everything for docs/benchmarks.md and makes it.

Exit code 1 if something is wrong, or (not with `--short`, which a busy machine disturbs) a goal is missed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path
from time import monotonic

from benchmarks import BENCHMARKS, CAMPAIGNS, limits, report
from benchmarks.goals import missed, sentence
from benchmarks.measuring import Result, machine, pin

_MODULES = {name: benchmark.module for name, benchmark in BENCHMARKS.items()} | CAMPAIGNS


def main() -> int:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(_MODULES))
    parser.add_argument(
        "--short", action="store_true", help="less exact; without names, what takes half a minute in all"
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument(
        "--publish",
        action="store_true",
        help="write the figures to benchmarks/figures/ and make the pages; without names, ten minutes of figures",
    )
    parser.add_argument(
        "--report", action="store_true", help="make docs/benchmarks.md and docs/limits.md from benchmarks/figures/"
    )
    args = parser.parse_args()
    if unknown := set(args.names) - _MODULES.keys():
        parser.error(f"no benchmark is named {', '.join(sorted(unknown))}; there are {', '.join(_MODULES)}")
    if args.short and args.publish:
        parser.error("--publish wants exact figures: leave out --short")
    results: Result = {"machine": machine()}
    for name in [] if args.report else args.names or _chosen(short=args.short, publish=args.publish):
        results[name] = _run(name, short=args.short)
        if args.publish:  # each at once, so that an interruption loses little
            _write(report.FIGURES / f"{name}.json", {"machine": results["machine"], name: results[name]})
    if args.output:
        _write(args.output, results)
    if args.report or args.publish:
        report.write()
        limits.write()
    return _judge(results, short=args.short)


def _chosen(*, short: bool, publish: bool) -> list[str]:
    """Return the benchmarks to run when none is named."""
    names = [name for name, benchmark in BENCHMARKS.items() if benchmark.is_short or not short]
    return names if publish else [*names, *CAMPAIGNS]


def _run(name: str, *, short: bool) -> Result:
    began = monotonic()
    pin()  # before each: one that needs more cores sets them for itself
    result: Result = importlib.import_module(_MODULES[name]).run(short=short)
    print(f"\n{name}: {monotonic() - began:.0f} s", flush=True)
    return result


def _write(path: Path, results: Result) -> None:
    path.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def _judge(results: Result, *, short: bool) -> int:
    """Print what is wrong and which goals are missed; return the exit code."""
    found = {name: result for name, result in results.items() if name != "machine"}
    wrong = [f"{name}: {fault}" for name, result in found.items() for fault in result.get("wrong", [])]
    slow = [f"{name}: {sentence(goal)}" for name, result in found.items() for goal in missed(result.get("goals", []))]
    for fault in wrong + slow:
        print(f"missed: {fault}", file=sys.stderr)
    return 1 if wrong or (slow and not short) else 0


if __name__ == "__main__":
    sys.exit(main())
