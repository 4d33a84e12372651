"""`python -m benchmarks [NAME ...] [--short] [--output FILE]`; `--report` makes the pages of figures anew.

Exit code 1 if something is wrong, or (not with `--short`, which a busy machine disturbs) a goal is missed.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path

from benchmarks import BENCHMARKS, limits, report
from benchmarks.goals import missed, sentence
from benchmarks.measuring import Result, machine, pin


def main() -> int:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(BENCHMARKS))
    parser.add_argument("--short", action="store_true", help="less exact; without names, what takes a minute in all")
    parser.add_argument("--output", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument(
        "--report", action="store_true", help="make docs/benchmarks.md and docs/limits.md from benchmarks/figures/"
    )
    args = parser.parse_args()
    if unknown := set(args.names) - set(BENCHMARKS):
        parser.error(f"no benchmark is named {', '.join(sorted(unknown))}; there are {', '.join(BENCHMARKS)}")
    if args.report:
        report.write()
        limits.write()
        return 0
    names = args.names or [name for name, (_, short, _) in BENCHMARKS.items() if short or not args.short]
    results: Result = {"machine": machine()}
    for name in names:
        pin()  # before each: one that needs more cores sets them for itself
        results[name] = importlib.import_module(BENCHMARKS[name][0]).run(short=args.short)
    if args.output:
        args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    wrong = [f"{name}: {fault}" for name in names for fault in results[name].get("wrong", [])]
    slow = [f"{name}: {sentence(goal)}" for name in names for goal in missed(results[name].get("goals", []))]
    for fault in wrong + slow:
        print(f"missed: {fault}", file=sys.stderr)
    return 1 if wrong or (slow and not args.short) else 0


if __name__ == "__main__":
    sys.exit(main())
