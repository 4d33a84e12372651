"""What servolink costs, as ratios to something everybody knows, measured in the same run: `python -m benchmarks`."""

from typing import NamedTuple


class Benchmark(NamedTuple):
    """A module with `run(*, short) -> Result`, and its section of docs/benchmarks.md."""

    module: str
    heading: str
    is_short: bool = True
    """Whether `--short` without names runs it."""
    is_campaign: bool = False
    """Whether it looks for faults rather than for time, the longer the better; `--publish` runs it only by name."""


BENCHMARKS = {
    "wire": Benchmark("benchmarks.wire", "The share of a line that is used"),
    "roundtrip": Benchmark("benchmarks.roundtrip", "A request and its response, layer by layer"),
    "pipelined": Benchmark("benchmarks.pipelined", "Several requests on a line at once"),
    "crowd": Benchmark("benchmarks.crowd", "Many callers at once"),
    "opening": Benchmark("benchmarks.opening", "From nothing to the first response"),
    "events": Benchmark("benchmarks.events", "Button events"),
    "start": Benchmark("benchmarks.start", "Time until a program or a command has started"),
    "scale": Benchmark("benchmarks.scale", "Many boards, and a board with a large library", is_short=False),
    "hub": Benchmark("benchmarks.hub", "A board that a hub shares"),
    "recorder": Benchmark("benchmarks.recorder", "A board that is recorded"),
    "fleet": Benchmark("benchmarks.fleet", "Many boards through a broker", is_short=False),
    "thousands": Benchmark("benchmarks.thousands", "Thousands of boards at one broker", is_short=False),
    "spy": Benchmark("benchmarks.spy", "A spy between a program and a board", is_short=False),
    "twin": Benchmark("benchmarks.twin", "A body with physics", is_short=False),
    "twin_uses": Benchmark("benchmarks.twin_uses", "Boards, learning and poses on the twin"),
    "studio": Benchmark("benchmarks.studio", "The studio in a browser", is_short=False),
    "firmware": Benchmark("benchmarks.firmware", "The firmware on an emulated Pico", is_short=False),
    "handoff": Benchmark("benchmarks.handoff", "From a reading thread to the event loop"),
    "parser": Benchmark("benchmarks.parser", "The parser against a textbook parser"),
    "peers": Benchmark("benchmarks.peers", "The parser against those of other libraries, each on its own format"),
    "packets": Benchmark("benchmarks.packets", "Bytes to typed packets and back, against bare tuples and other tools"),
    "hostile": Benchmark("benchmarks.hostile", "Streams made to be expensive"),
    "recall": Benchmark("benchmarks.recall", "Intact frames found on a damaged line"),
    "reliability": Benchmark(
        "benchmarks.reliability", "Conversations on bad lines, with bad boards and busy programs", is_campaign=True
    ),
    "fuzz": Benchmark(
        "benchmarks.fuzz.campaign",
        "Random and mutated input for everything that takes bytes",
        is_short=False,
        is_campaign=True,
    ),
    "imports": Benchmark("benchmarks.imports", "Projects written while the cable is pulled", is_campaign=True),
}
"""In the order of docs/benchmarks.md: first the waits of a user, then their parts, then faults."""
