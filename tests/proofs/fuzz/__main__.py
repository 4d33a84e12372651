"""`python -m tests.proofs.fuzz --minutes M`: so many minutes more of the runs that the figures count.

With `--output FILE` what earlier runs have counted there is added to. Exit code 1 if something was found; each
finding is printed with its input, which belongs in tests/proofs/fuzz/recorded.py.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

from benchmarks.measuring import Result, machine
from servolink.support import write_atomically
from tests.proofs.fuzz.campaign import Campaign

_NAME = "fuzz"


def main() -> int:
    """Run, and write after each turn."""
    parser = argparse.ArgumentParser(prog="python -m tests.proofs.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, required=True, metavar="M", help="how long at most")
    parser.add_argument("--output", type=Path, metavar="FILE", help="figures to add to, and to write")
    parser.add_argument("--corpus", type=Path, metavar="FOLDER", help="where the guided inputs stay for the next run")
    args = parser.parse_args()
    before = json.loads(args.output.read_text(encoding="utf-8")) if args.output and args.output.exists() else {}
    campaign = Campaign.of(before.get(_NAME, {}))
    with tempfile.TemporaryDirectory() as folder:
        for _ in campaign.rounds(args.minutes * 60, args.corpus or Path(folder)):
            _write(args.output, campaign.counted())
    _write(args.output, campaign.result())
    return 1 if campaign.findings else 0


def _write(path: Path | None, result: Result) -> None:
    if path:
        write_atomically(path, json.dumps({"machine": machine(), _NAME: result}, indent=1).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(main())
