"""What servolink costs, as ratios to something everybody knows, measured in the same run: `python -m benchmarks`."""

BENCHMARKS = {
    "parser": ("benchmarks.parser", True, "The parser against a textbook parser"),
    "peers": ("benchmarks.peers", True, "The parser against those of other libraries, each on its own format"),
    "packets": ("benchmarks.packets", True, "Bytes to typed packets and back, against bare tuples and other tools"),
    "hostile": ("benchmarks.hostile", True, "Streams made to be expensive"),
    "recall": ("benchmarks.recall", True, "Intact frames found on a damaged line"),
    "reliability": ("benchmarks.reliability", True, "Conversations on bad lines, with bad boards and busy programs"),
    "roundtrip": ("benchmarks.roundtrip", True, "A request and its response, layer by layer"),
    "handoff": ("benchmarks.handoff", True, "From a reading thread to the event loop"),
    "start": ("benchmarks.start", False, "Time until a program or a command has started"),
    "scale": ("benchmarks.scale", False, "Many boards, and a board with a large library"),
    "fuzz": ("benchmarks.fuzz.campaign", False, "Random and mutated input for everything that takes bytes"),
    "imports": ("benchmarks.imports", True, "Projects written while the cable is pulled"),
}
"""Name to the module, whether `--short` without names runs it, and its heading, in the order of docs/benchmarks.md.

Each module has `run(*, short) -> Result`. To publish its figures:
`python -m benchmarks NAME --output benchmarks/figures/NAME.json && python -m benchmarks --report`.
"""
