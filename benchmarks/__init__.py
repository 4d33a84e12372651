"""What servolink costs, as ratios to something everybody knows, measured in the same run: `python -m benchmarks`."""

BENCHMARKS = {
    "parser": ("benchmarks.parser", True, "The parser against the one that a textbook has"),
    "peers": ("benchmarks.peers", True, "The parser against those of other libraries, each on its own format"),
    "packets": ("benchmarks.packets", True, "Bytes to typed packets and back, beside bare tuples and other tools"),
    "compiled": ("benchmarks.compiled", True, "The compiled loops, beside pure Python and a parser by Cython"),
    "hostile": ("benchmarks.hostile", True, "Streams that were made to hurt"),
    "recall": ("benchmarks.recall", True, "Intact frames found on a damaged line"),
    "reliability": ("benchmarks.reliability", True, "Conversations on bad lines, with bad boards and busy programs"),
    "roundtrip": ("benchmarks.roundtrip", True, "A request and its answer, layer by layer"),
    "handoff": ("benchmarks.handoff", True, "From a thread that reads to the event loop"),
    "start": ("benchmarks.start", False, "Until a program or a command has begun"),
    "scale": ("benchmarks.scale", False, "Many boards, and a board with a large library"),
    "fuzz": ("benchmarks.fuzz.campaign", False, "Random and mutated bytes into everything that takes bytes"),
    "imports": ("benchmarks.imports", True, "Projects written while the cable is pulled"),
}
"""Name to the module, whether `--short` without names runs it, and its heading, in the order of docs/benchmarks.md.

Each module has `run(*, short) -> Result`. To publish its figures:
`python -m benchmarks NAME --output benchmarks/figures/NAME.json && python -m benchmarks --report`.
"""
