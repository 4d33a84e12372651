"""What servolink costs, as ratios to something everybody knows, measured in the same run: `python -m benchmarks`."""

from typing import NamedTuple


class Benchmark(NamedTuple):
    """A module with `run(*, short) -> Result`, and its section of docs/benchmarks.md."""

    module: str
    heading: str
    is_short: bool = True
    """Whether `--short` without names runs it."""


BENCHMARKS = {
    "parser": Benchmark("benchmarks.parser", "The parser against a textbook parser"),
    "peers": Benchmark("benchmarks.peers", "The parser against those of other libraries, each on its own format"),
    "packets": Benchmark("benchmarks.packets", "Bytes to typed packets and back, beside other tools"),
    "wire": Benchmark("benchmarks.wire", "The share of a line that is used"),
    "roundtrip": Benchmark("benchmarks.roundtrip", "A request and its response"),
    "pipelined": Benchmark("benchmarks.pipelined", "Several requests on a line at once"),
    "events": Benchmark("benchmarks.events", "Button events"),
    "start": Benchmark("benchmarks.start", "Time until a program or a command has started"),
    "hub": Benchmark("benchmarks.hub", "A board that a hub shares"),
    "recorder": Benchmark("benchmarks.recorder", "A board that is recorded"),
    "fleet": Benchmark("benchmarks.fleet", "Many boards through a broker", is_short=False),
    "thousands": Benchmark("benchmarks.thousands", "Thousands of boards at one broker", is_short=False),
    "twin": Benchmark("benchmarks.twin", "A body with physics", is_short=False),
    "studio": Benchmark("benchmarks.studio", "The studio in a browser", is_short=False),
}
"""In the order of docs/benchmarks.md."""

CAMPAIGNS = {
    "recall": "tests.proofs.recall",
    "reliability": "tests.proofs.reliability",
    "imports": "tests.proofs.imports",
}
"""Modules that look for faults rather than for time, the longer the better; docs/limits.md has their figures."""
