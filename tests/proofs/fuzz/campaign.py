"""All targets in turns, until enough inputs have been run; what one run counts, the next adds to."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.measuring import Result, table
from tests.proofs.fuzz.recorded import RECORDED
from tests.proofs.fuzz.rounds import GUIDED, Turn, guided, mutated
from tests.proofs.fuzz.targets import TARGETS

GOAL = 100_000_000
"""Inputs in all."""
_TURN = 20.0
"""Seconds of a target with a share of 1 in each round, for each of the two ways."""
_SHORT = 2_000
_SHORT_SECONDS = 3.0


@dataclass
class Count:
    """What was run of one target so far."""

    mutated: int = 0
    guided: int = 0
    seconds: float = 0.0
    corpus: int = 0
    """Inputs that reach something the others do not."""
    corpus_bytes: int = 0
    largest: int = 0
    """Bytes of the largest of them."""
    edges: int = 0
    features: int = 0

    @property
    def inputs(self) -> int:
        """All inputs."""
        return self.mutated + self.guided


@dataclass
class Campaign:
    """The counts of all targets, and what was found."""

    counts: dict[str, Count] = field(default_factory=lambda: {name: Count() for name in TARGETS})
    findings: list[str] = field(default_factory=list)
    seed: int = 1

    @classmethod
    def of(cls, result: Result) -> Campaign:
        """Go on with what an earlier run has counted."""
        counts = {name: Count(**result.get("counts", {}).get(name, {})) for name in TARGETS}
        return cls(counts, [], int(result.get("seed", 1)))

    @property
    def inputs(self) -> int:
        """All inputs of all targets."""
        return sum(count.inputs for count in self.counts.values())

    def rounds(self, seconds: float, corpus: Path) -> Iterator[None]:
        """Run turn after turn until the goal is reached or the time is over; yield after each."""
        begun = perf_counter()
        while True:
            for name, target in TARGETS.items():
                left = seconds - (perf_counter() - begun)
                if left <= 0 or self.inputs >= GOAL:
                    return
                self.seed += 1
                self._add(name, mutated(name, min(left, _TURN * target.share), self.seed))
                if GUIDED:
                    self._add_guided(name, guided(name, min(left, _TURN), corpus), corpus)
                yield

    def short(self) -> None:
        """Run a few mutations of each target."""
        for name in TARGETS:
            self._add(name, mutated(name, _SHORT_SECONDS, self.seed, _SHORT))

    def _add(self, name: str, turn: Turn) -> None:
        self.counts[name].mutated += turn.inputs
        self.counts[name].seconds += turn.seconds
        self._note(name, turn)

    def _add_guided(self, name: str, turn: Turn, corpus: Path) -> None:
        count = self.counts[name]
        count.guided += turn.inputs
        count.seconds += turn.seconds
        sizes = [path.stat().st_size for path in (corpus / name).iterdir()]
        count.corpus, count.corpus_bytes, count.largest = len(sizes), sum(sizes), max(sizes)
        count.edges, count.features = max(count.edges, turn.edges), max(count.features, turn.features)
        self._note(name, turn)

    def _note(self, name: str, turn: Turn) -> None:
        if turn.finding:
            print(f"{name}: {turn.finding}", flush=True)
            if (finding := f"{name}: {turn.finding.splitlines()[-1]}") not in self.findings:
                self.findings.append(finding)

    def counted(self) -> Result:
        """Return counts and findings."""
        return {
            "counts": {name: dict(vars(count)) for name, count in self.counts.items()},
            "seed": self.seed,
            "inputs": self.inputs,
            "wrong": self.findings,
        }

    def result(self) -> Result:
        """Return the same with the tables of the page."""
        return {**self.counted(), "tables": [_inputs(self), _found()]}


def run(*, short: bool) -> Result:
    """Run 100 million inputs, which takes hours; with `short` a few thousand of each target."""
    campaign = Campaign()
    if short:
        campaign.short()
        return campaign.result()
    with tempfile.TemporaryDirectory() as corpus:
        for _ in campaign.rounds(float("inf"), Path(corpus)):
            print(f"{campaign.inputs:,} inputs", flush=True)
    return campaign.result()


def _inputs(campaign: Campaign) -> Any:
    rows: list[Sequence[str]] = [
        (
            TARGETS[name].what,
            f"{count.mutated:,}",
            f"{count.guided:,}",
            *((f"{count.corpus:,}", f"{count.edges:,}", f"{count.features:,}") if count.corpus else ("", "", "")),
            f"{count.largest:,} B" if count.corpus else "",
        )
        for name, count in campaign.counts.items()
    ]
    total = [sum(getattr(count, way) for count in campaign.counts.values()) for way in ("mutated", "guided")]
    rows.append(("all", *(f"{number:,}" for number in total), "", "", "", ""))
    notes = [
        "Mutated: seeds changed at random, without a look at what the program does.",
        "Guided: inputs of a coverage-guided fuzzer, atheris (libFuzzer), in processes of its own.",
        "Corpus: the guided inputs that reach something new, and the edges and features of the code that they reach.",
        "Largest: the longest input of the corpus.",
        "All runs are added up, each on the code of its day.",
    ]
    return table(
        f"{campaign.inputs:,} inputs",
        ("bytes taken for", "mutated", "guided", "corpus", "edges", "features", "largest"),
        rows,
        notes,
    )


def _found() -> Any:
    return table(
        "findings, each fixed and kept as a test",
        ("bytes taken for", "what was wrong"),
        [(TARGETS[one.target].what, one.wrong) for one in RECORDED],
    )
