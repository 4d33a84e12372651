"""`python -m benchmarks [NAME ...] [--short] [--output FILE]`.

Exit code 1 if something is wrong, or (not with `--short`, which a busy machine disturbs) slower than its goal.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path

from benchmarks.measuring import machine

BENCHMARKS = ("parser", "packets", "hostile", "recall")
"""Modules here; each has `run(*, short) -> Result`, which prints a table too."""


def main() -> int:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(BENCHMARKS))
    parser.add_argument("--short", action="store_true", help="less exact, all in under 20 s")
    parser.add_argument("--output", type=Path, metavar="FILE", help="write all figures as JSON")
    args = parser.parse_args()
    if unknown := set(args.names) - set(BENCHMARKS):
        parser.error(f"no benchmark is named {', '.join(sorted(unknown))}; there are {', '.join(BENCHMARKS)}")
    results = {"machine": machine()}
    for name in args.names or BENCHMARKS:
        results[name] = importlib.import_module(f"benchmarks.{name}").run(short=args.short)
    if args.output:
        args.output.write_text(json.dumps(results, indent=1) + "\n")
    wrong = [f"{name}: {fault}" for name, result in results.items() for fault in result.get("wrong", [])]
    slow = [f"{name}: {fault}" for name, result in results.items() for fault in result.get("slow", [])]
    for fault in wrong + slow:
        print(f"missed: {fault}", file=sys.stderr)
    return 1 if wrong or (slow and not args.short) else 0


if __name__ == "__main__":
    sys.exit(main())
