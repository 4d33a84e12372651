"""Look for wrong answers, lost answers, things done twice and leaks; or live through one history again.

`--seed N` alone shows the history of one seed. `--record` publishes the figures of a part; afterwards run
`python -m benchmarks --report`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.measuring import Result, machine
from benchmarks.report import FIGURES
from servolink.errors import escape
from tests.proofs.reliability import (
    PARTS,
    flood,
    framing,
    hidden,
    hub,
    installation,
    lossy,
    model,
    reopening,
    simulation,
    soak,
    stalls,
    stops,
    sums,
    together,
)
from tests.proofs.reliability.history import STEPS, History, relive
from tests.proofs.reliability.hub_history import HubHistory, relive_sharing

RECORD = FIGURES / "reliability.json"


def main() -> int:
    """Do what the arguments say; 1 if something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.proofs.reliability", description=__doc__)
    parser.add_argument("part", nargs="?", choices=PARTS, default="simulation")
    parser.add_argument("--short", action="store_true", help="a slice that takes seconds")
    parser.add_argument("--record", action="store_true", help="publish the figures")
    parser.add_argument("--seed", type=int, metavar="N", help="live through the history of one seed and show its end")
    parser.add_argument("--steps", type=int, metavar="N", help="simulation, hub: calls in a history")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="simulation, hub: the first seed")
    parser.add_argument("--histories", type=int, metavar="N", help="simulation, hub: how many seeds")
    parser.add_argument("--python", action="append", metavar="PATH", help="stalls: an interpreter to try, any number")
    parser.add_argument("--real", action="store_true", help="stalls: also in real time, over a pseudo-terminal")
    parser.add_argument("--hours", type=float, default=2.0, help="soak, installation: for how long")
    parser.add_argument("--virtual", action="store_true", help="soak: in virtual time, not over a pseudo-terminal")
    args = parser.parse_args()
    if args.seed is not None:
        if args.part == "stops":
            return _replay_stop(args.seed)
        return (_replay_sharing if args.part == "hub" else _replay)(args.seed, args.steps or STEPS)
    begun = time.monotonic()
    result = _work(args)()
    result |= {
        "machine": machine(),
        "seconds": round(time.monotonic() - begun),
        "command": [Path(word).name for word in sys.argv[1:]],
    }
    if args.record:
        _record(args.part if args.part != "soak" or not args.virtual else "soak, virtual", result)
    for fault in result["wrong"]:
        print(f"wrong: {fault}", file=sys.stderr)
    return 1 if result["wrong"] else 0


def _work(args: argparse.Namespace) -> Callable[[], Result]:
    pythons = tuple(args.python or [sys.executable])
    work: dict[str, Callable[..., Result]] = {
        "model": model.run,
        "simulation": partial(simulation.run, first=args.first, histories=args.histories, steps=args.steps or STEPS),
        "framing": framing.run,
        "hidden": hidden.run,
        "sums": sums.run,
        "stalls": partial(stalls.run, pythons=pythons, real=args.real),
        "flood": flood.run,
        "lossy": lossy.run,
        "reopening": reopening.run,
        "stops": stops.run,
        "hub": partial(hub.run, first=args.first, histories=args.histories, steps=args.steps),
        "soak": partial(soak.run, hours=args.hours, virtual=args.virtual),
        "installation": partial(installation.run, hours=args.hours),
    }
    return partial(work[args.part], short=args.short)


def _replay(seed: int, steps: int) -> int:
    history = relive(seed, steps)
    scene = history.scene
    callers = f"{scene.callers} callers, depth {scene.depth}"
    status = _show(history, f"{scene.line.name}; board: {scene.board.name}; {scene.load}; {callers}", f"{steps} calls")
    print(f"history {history.digest}")
    return status


def _replay_sharing(seed: int, steps: int) -> int:
    history = relive_sharing(seed, steps)
    scene = history.scene
    pulled = "; the cable is pulled" if scene.pulled else ""
    line = f"{scene.programs} programs; {scene.line.name}; board: {scene.board.name}; depth {scene.depth}{pulled}"
    return _show(history, line, f"{steps} requests")


def _replay_stop(seed: int) -> int:
    scene, seen = stops.relive_stop(seed)
    print(f"seed {seed}: {scene}")
    for when, packet in seen.sent:
        print(f"{when:14.6f}  {escape(str(packet))}")
    print(f"stop: {seen.stop}; movement: {seen.movement}")
    for fault in seen.faults:
        print(f"wrong: {fault}", file=sys.stderr)
    return 1 if seen.faults else 0


def _show(history: History | HubHistory, scene: str, work: str) -> int:
    """Print how a history of so much work went and ended; return 1 if something in it is wrong."""
    print(f"seed {history.scene.seed}: {scene}")
    for when, event, what in history.latest:
        print(f"{when:14.6f}  {event:16} {what.hex(' ') if isinstance(what, bytes) else escape(what)}")
    print(f"{work} in {history.seconds:.0f} s of virtual time: {dict(history.counts)}")
    for fault in history.faults:
        print(f"wrong: {fault}", file=sys.stderr)
    return 1 if history.faults else 0


def _record(name: str, result: Result) -> None:
    before = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    parts = before.get("reliability", {}).get("parts", {})
    record = {"machine": machine(), "reliability": together(dict(sorted({**parts, name: result}.items())))}
    RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
