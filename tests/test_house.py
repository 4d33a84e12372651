"""Ceilings of the house: figures that tell how much a reader must hold at once. They are only ever lowered.

Doors and arrows are in `test_imports.py`, shared names in `test_names.py`.
"""

from __future__ import annotations

import ast
import re
import statistics
import sys
from collections import Counter
from pathlib import Path

from tests import processes
from tests.syntax import modules_below, nodes_of

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "servolink"
FILES = modules_below(PACKAGE)

CEILINGS = {
    "lines": 80_674,
    "files": 478,
    "names that cross rooms": 610,
    "own imports of a file, median": 5,
    "own imports of a file, 90 %": 12,
    "own imports of a file, most": 24,
    "blocks of TYPE_CHECKING": 21,
    "calls of the garbage collector": 4,
    "private members of others": 14,
    "classes with more than 15 attributes": 17,
    "functions with more than 8 arguments": 5,
    "lines of benchmarks": 6_262,
    "lines of JavaScript": 18_404,
}

LATE = {
    "__init__.py": (2, "the names of the package are loaded on first use"),
    "__main__.py": (5, "Ctrl-C is not caught before"),
    "boards/toml_text.py": (1, "tomlkit: most programs write no file of settings"),
    "cli/arguments.py": (4, "command: the help of all commands needs no board"),
    "cli/command_line.py": (1, "command: the version"),
    "cli/fleet/broker_options.py": (2, "extra fleet"),
    "cli/fleet/fleet_apply.py": (3, "extra fleet"),
    "cli/fleet/fleet_join.py": (1, "extra fleet"),
    "cli/fleet/fleet_metrics.py": (1, "extra metrics"),
    "cli/motion/trim.py": (2, "rich: pictures in a terminal"),
    "cli/projects/play.py": (1, "rich: pictures in a terminal"),
    "cli/recordings/convert.py": (1, "extra foxglove"),
    "cli/recordings/foxglove_live.py": (2, "extra foxglove"),
    "cli/recordings/record_view.py": (2, "rich: pictures in a terminal"),
    "cli/recordings/show.py": (1, "rich: pictures in a terminal"),
    "cli/screen/live.py": (10, "rich: pictures in a terminal"),
    "cli/screen/output.py": (6, "rich: tables in a terminal"),
    "cli/together/language_models.py": (2, "extra mcp"),
    "cli/together/ros2.py": (1, "extra ros2"),
    "cli/together/studio.py": (2, "extra studio"),
    "doctor/system.py": (1, "driver of USB"),
    "fleet/access.py": (2, "keyring: where the system keeps passwords"),
    "recorder/mcap_check.py": (3, "extra record"),
    "recorder/mcap_index.py": (1, "extra record"),
    "recorder/mcap_reader.py": (2, "compressed recordings of other programs"),
    "recorder/mcap_stream.py": (2, "extra record"),
    "studio/fleet_methods.py": (2, "extra fleet"),
    "studio/links.py": (1, "extra studio: a page without a server has no links"),
    "transports/serial_ports.py": (1, "driver of serial ports"),
    "transports/usb_devices.py": (1, "driver of USB"),
    "twin/measuring.py": (1, "extra twin: NumPy"),
    "twin/reach.py": (6, "extra twin: NumPy"),
    "twin/urdf_reading.py": (1, "defusedxml: only an import reads XML"),
    "twin/trial.py": (1, "extra twin: NumPy"),
}
"""Imports within functions: how many of a file, and what makes them late: an extra, a driver, a command or a system."""

WAYS = {"hub move": 47, "fleet move": 70, "CLI move": 74, "CLI apply": 84}
"""Files of the package that each way crosses, as `python -m benchmarks.walk` counts them."""
TOLERANCE = 2  # also for the telemetry of a fleet, which may come into a walk: it has six files more

SMALL = 40  # lines of a file whose imports say nothing


def room_of(module: str) -> str:
    """Return the room of a module, empty for the package itself."""
    return module.split(".")[1] if "." in module else ""


def own_imports(path: Path) -> list[tuple[str, str]]:
    """Return module and name of each import from servolink in a file."""
    return [
        (node.module or "", each.name)
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "servolink"
        for each in node.names
    ]


def imports_within_functions(path: Path) -> int:
    """Return how many imports of a file wait for a call; only a file with an indented import is parsed."""
    if not re.search(r"^\s+(?:from|import)\s", path.read_text(encoding="utf-8"), re.MULTILINE):
        return 0
    return len(
        {
            inner.lineno
            for node in nodes_of(path)
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            for inner in ast.walk(node)
            if isinstance(inner, ast.Import | ast.ImportFrom)
        }
    )


def arguments(path: Path) -> list[int]:
    """Return the number of arguments of each function, without the object of a method."""
    found = []
    for node in nodes_of(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            named = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            found.append(len(named) - (named[:1] in (["self"], ["cls"])))
    return found


def attributes(path: Path) -> list[int]:
    """Return the number of attributes of each class, declared or set by its methods."""
    found = []
    for class_ in (node for node in nodes_of(path) if isinstance(node, ast.ClassDef)):
        declared = {ast.unparse(node.target) for node in class_.body if isinstance(node, ast.AnnAssign)}
        stored = [
            node for node in ast.walk(class_) if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
        ]
        found.append(len(declared | {node.attr for node in stored if ast.unparse(node.value) == "self"}))
    return found


def figures() -> dict[str, float]:
    """Return each figure that has a ceiling."""
    texts = [path.read_text(encoding="utf-8") for path in FILES]
    crossing, modules, large, long = set(), [], 0, 0
    for path, text in zip(FILES, texts, strict=True):
        room, imports = path.relative_to(PACKAGE).parts[0].removesuffix(".py"), own_imports(path)
        crossing |= {(room_of(module), name) for module, name in imports if room_of(module) != room}
        if text.count("\n") > SMALL and (count := len({module for module, _ in imports})):
            modules.append(count)
        large += sum(count > 15 for count in attributes(path))
        long += sum(count > 8 for count in arguments(path))
    modules.sort()
    return {
        "lines": sum(text.count("\n") for text in texts),
        "files": len(FILES),
        "names that cross rooms": len(crossing),
        "own imports of a file, median": statistics.median(modules),
        "own imports of a file, 90 %": modules[len(modules) * 9 // 10],
        "own imports of a file, most": modules[-1],
        "blocks of TYPE_CHECKING": sum(len(re.findall(r"^if TYPE_CHECKING", text, re.MULTILINE)) for text in texts),
        "calls of the garbage collector": sum(len(re.findall(r"\bgc\.\w+", text)) for text in texts),
        "private members of others": sum(text.count("SLF001") for text in texts),
        "classes with more than 15 attributes": large,
        "functions with more than 8 arguments": long,
        "lines of benchmarks": sum(
            path.read_text(encoding="utf-8").count("\n") for path in (ROOT / "benchmarks").rglob("*.py")
        ),
        "lines of JavaScript": sum(
            path.read_text(encoding="utf-8").count("\n")
            for path in (PACKAGE / "studio/web").rglob("*.js")
            if "vendor" not in path.parts
        ),
    }


def test_ceilings_hold() -> None:
    assert {name: figure for name, figure in figures().items() if figure > CEILINGS[name]} == {}


def test_an_import_within_a_function_has_a_reason() -> None:
    found = Counter({str(path.relative_to(PACKAGE)): imports_within_functions(path) for path in FILES})
    assert {name: number for name, number in found.items() if number} == {
        name: number for name, (number, _) in LATE.items()
    }


def test_ways_cross_few_files() -> None:
    walked = processes.run([sys.executable, "-m", "benchmarks.walk"], cwd=ROOT, check=True)
    crossed = {name: int(files) for name, files in re.findall(r"^(\w+ \w+) +(\d+) files", walked.stderr, re.MULTILINE)}
    assert {"hub move", "CLI move", "CLI apply"} <= crossed.keys()
    assert {name: files for name, files in crossed.items() if files > WAYS[name] + TOLERANCE} == {}
