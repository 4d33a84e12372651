"""Imports go one way, through doors, without circles; a room without clock and I/O imports neither."""

from __future__ import annotations

import ast
import json
import re
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

import servolink
from tests import processes
from tests.extras import NEEDED, not_importable
from tests.sampling import every, some
from tests.syntax import modules_below, nodes_of, tree_of

PACKAGE = Path(__file__).parents[1] / "servolink"
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in modules_below(PACKAGE)
}

ARCHITECTURE = PACKAGE.parent / "docs/design/architecture.md"
MAY_IMPORT = {
    part: set(re.findall(r"`(\w+)`", others))
    for part, others in re.findall(r"^\| `(\w+)` \| ([^|]+) \|", ARCHITECTURE.read_text(encoding="utf-8"), re.MULTILINE)
}
"""What each room may import besides itself and `errors`, as the architecture page says."""

ORDERS = {
    part: [set(re.findall(r"`(\w+)`", step)) for step in steps.split("<")]
    for part, steps in re.findall(
        r"^`(\w+)`: ([^\n]*(?:\n`[^\n]*)*)", ARCHITECTURE.read_text(encoding="utf-8"), re.MULTILINE
    )
}
"""The modules of a part in steps, each of which may import those before it, as the architecture page says."""

EVERYWHERE = {"errors"}
"""Rooms that all others may import."""

INNER_DOORS = {"gateways"}
"""Rooms whose rooms have doors of their own: one for each protocol."""

TESTS = Path(__file__).parent

REPLACING = re.compile(r"\.(?:set|del)attr\(\s*[frb]*[\"']")
"""Calls of `replaced_names`: only a file with one is searched for their names."""

FLOORS = [
    set(re.findall(r"\w+", row))
    for row in re.findall(r"^([\w ]+)\|", ARCHITECTURE.read_text(encoding="utf-8").partition("## ")[0], re.MULTILINE)
]
"""The parts on each floor of the picture, from the top."""

OUTSIDE_WORLD = {
    "asyncio",
    "datetime",
    "logging",
    "multiprocessing",
    "random",
    "select",
    "selectors",
    "serial",
    "signal",
    "socket",
    "subprocess",
    "threading",
    "time",
}
"""Modules for which a part that is passed bytes and times has no use."""
SERVING = {
    "servolink.virtual.servers",
    "servolink.virtual.transport",
}
"""The modules of `virtual` that connect a board to the world; the others are the board."""


SYSTEM_MODULES = {"fcntl", "grp", "msvcrt", "pty", "pwd", "resource", "select", "termios", "tty"}
"""Modules that not every system has, or of which not every system has all."""
SYSTEM_NAMES = {
    "os.name",
    "sys.platform",
    "socket.AF_UNIX",
    *(f"os.{name}" for name in ("fork", "getegid", "geteuid", "getgid", "getgroups", "getuid", "openpty", "tcgetpgrp")),
    *(f"signal.{name}" for name in ("SIGBREAK", "SIGHUP", "SIGKILL", "SIGUSR1", "SIGUSR2")),
}
LOOP_METHODS = {
    *("add_reader", "add_signal_handler", "add_writer", "create_unix_connection", "create_unix_server"),
    "call_at",
}
"""Methods that the event loop of Windows does not have; and one that fails in Pyodide for times that have passed."""
SYSTEM_WORDS = re.compile(
    rf"\b({'|'.join(SYSTEM_MODULES | LOOP_METHODS | {name.partition('.')[2] for name in SYSTEM_NAMES} - {'name'})})\b"
    r"|\bos\.name\b|\bfrom os import\b"
)
"""Words of all of these: only a module with such a word is parsed."""
SYSTEM_EXCEPTIONS = {
    ("servolink.doctor.system", "sys.platform"): "a fact like others, which tests replace",
    ("servolink.transports.hid_devices", "sys.platform"): "a library has one module more on Linux",
    ("servolink.support.json_text", "sys.platform"): "the stack of Pyodide, which Python does not guard",
    ("servolink.testing", "sys.platform"): "an event loop of tests, which needs no sockets",
    ("servolink.doctor.wireshark.dissector", "sys.platform"): "the default of a parameter",
}
"""Modules beside `support.platforms` that differ between systems, and why."""


def part_of(module: str) -> str:
    """Return the part of the package that `module` belongs to, `servolink` for the package itself."""
    return module.split(".")[1] if "." in module else module


@cache
def imported(path: Path) -> list[tuple[str, str]]:
    """Return module and name of each import in a file, including those inside functions."""
    found = []
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: write imports in full"
            found += [(node.module or "", alias.name) for alias in node.names]
    return found


def own_modules(module: str) -> set[str]:
    """Return the modules of servolink that `module` imports."""
    found = set()
    for source, name in imported(MODULES[module]):
        if source.partition(".")[0] == "servolink":
            found.add(f"{source}.{name}" if f"{source}.{name}" in MODULES else source)
    return found


def is_passed_everything(module: str) -> bool:
    """Return whether `module` is passed bytes and times and has no access of its own to them."""
    return part_of(module) in {"protocol", "motion", "virtual"} and module not in SERVING


def test_every_part_has_its_rule() -> None:
    assert {part_of(module) for module in MODULES} == set(MAY_IMPORT)


def test_parts_import_what_the_page_lists() -> None:
    found = {part: set[str]() for part in MAY_IMPORT}
    for module in MODULES:
        found[part_of(module)] |= {part_of(source) for source in own_modules(module)}
    assert {part: others - EVERYWHERE - {part} for part, others in found.items()} == MAY_IMPORT


def test_the_package_knows_nothing_of_its_tests() -> None:
    found = {(module, source) for module, path in MODULES.items() for source, _ in imported(path)}
    assert {pair for pair in found if pair[1].partition(".")[0] in {"tests", "benchmarks", "docs"}} == set()


def test_imports_lead_down_in_the_picture() -> None:
    floor_of = {part: floor for floor, parts in enumerate(FLOORS) for part in parts}
    assert set(floor_of) == set(MAY_IMPORT) - EVERYWHERE - {"servolink", "__main__"}
    assert {
        (part, low) for part in floor_of for low in MAY_IMPORT[part] & set(floor_of) if floor_of[low] <= floor_of[part]
    } == set()


def doors_of(module: str) -> set[str]:
    """Return the doors through which other rooms reach `module`."""
    parts = module.split(".")
    return {".".join(parts[: 3 if parts[1] in INNER_DOORS else 2]), ".".join(parts[:2])}


def past_doors(path: Path, room: str) -> list[str]:
    """Return the imports of a file in `room` that go past the door of another room, or name what no door has."""
    found = []
    for source, name in imported(path):
        if not source.startswith("servolink.") or not is_elsewhere(source, room):
            continue
        if not name:
            found += [source] if source.count(".") > 1 else []
        elif source not in doors_of(source):
            found.append(source)
        elif source in MODULES and source != "servolink.__main__":
            public = vars(import_module(source)).get("__all__")
            if public is not None and name not in public:
                found.append(f"{source}: {name}")
    found += [name for name in replaced_names(path) if is_elsewhere(name, room) and not is_in_door(name)]
    return [f"{path.relative_to(PACKAGE.parent)}: {each}" for each in found]


def replaced_names(path: Path) -> Iterator[str]:
    """Yield the names that calls in a file such as `monkeypatch.setattr("servolink.room.name", ...)` replace."""
    if not REPLACING.search(path.read_text(encoding="utf-8")):
        return
    for node in nodes_of(path):
        match node:
            case ast.Call(func=ast.Attribute(attr="setattr" | "delattr"), args=[ast.Constant(value=str(name)), *_]):
                yield name


def is_in_door(name: str) -> bool:
    """Return whether `name`, with its modules, is one of a door."""
    return name.rpartition(".")[0] in doors_of(name)


def is_elsewhere(module: str, room: str) -> bool:
    """Return whether `module` belongs to servolink, and to another room."""
    return module.startswith("servolink.") and part_of(module) != room


def test_rooms_use_the_doors_of_other_rooms() -> None:
    assert [line for module, path in MODULES.items() for line in past_doors(path, part_of(module))] == []


def test_tests_use_the_doors_of_other_rooms() -> None:
    files = {path: path.relative_to(TESTS).parts for path in modules_below(TESTS)}
    found = [line for path, parts in files.items() for line in past_doors(path, parts[0])]
    assert found == []


@pytest.mark.parametrize("room", sorted(part for part in MAY_IMPORT if (PACKAGE / part).is_dir() and part != "cli"))
def test_a_door_names_each_name_once(room: str) -> None:
    door = import_module(f"servolink.{room}")
    assert len(set(door.__all__)) == len(door.__all__)
    assert [name for name in door.__all__ if name.startswith("_")] == []


def test_no_import_circle() -> None:
    graph = {module: own_modules(module) - {module, "servolink"} for module in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("part", ORDERS)
def test_modules_of_a_part_import_only_those_of_earlier_steps(part: str) -> None:
    step_of = {name: number for number, step in enumerate(ORDERS[part]) for name in step}
    own = {module for module in MODULES if module.startswith(f"servolink.{part}.")}
    assert {module.split(".")[2] for module in own} == set(step_of)
    found = {
        (module, source)
        for module in own
        for source in own_modules(module) & own
        if (name := source.split(".")[2]) != module.split(".")[2]
        if step_of[name] >= step_of[module.split(".")[2]]
    }
    assert found == set()


def system_dependent(module: str) -> set[str]:
    """Return what `module` uses that not every system has, and how it asks which system this is."""
    if not SYSTEM_WORDS.search(MODULES[module].read_text(encoding="utf-8")):
        return set()
    found = {source.partition(".")[0] for source, _ in imported(MODULES[module])} & SYSTEM_MODULES
    found |= {f"{source}.{name}" for source, name in imported(MODULES[module])} & SYSTEM_NAMES
    for node in nodes_of(MODULES[module]):
        if isinstance(node, ast.Attribute):
            found |= {ast.unparse(node)} & SYSTEM_NAMES | {node.attr} & LOOP_METHODS
    return found


def test_only_platforms_knows_systems() -> None:
    found = {
        (module, used)
        for module in MODULES
        if not module.startswith("servolink.support.platforms")
        for used in system_dependent(module)
    }
    assert found == set(SYSTEM_EXCEPTIONS)


def test_every_serving_module_exists() -> None:
    assert set(MODULES) >= SERVING


def test_protocol_and_virtual_board_are_passed_bytes_and_times() -> None:
    world = {
        (module, source)
        for module in filter(is_passed_everything, MODULES)
        for source, name in imported(MODULES[module])
        if source.partition(".")[0] in OUTSIDE_WORLD and (source, name) != ("random", "Random")
    }
    assert world == set()


def test_chance_has_a_seed() -> None:
    for path in MODULES.values():
        names = {name for source, name in imported(path) if source == "random"}
        assert names <= {"Random"}, path
        calls = [
            node
            for node in (ast.walk(tree_of(path)) if names else ())
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Random")
        ]
        assert all(call.args for call in calls), path


def test_the_public_names_are_those_that_type_checkers_see() -> None:
    seen = {
        (node.module, alias.name)
        for node in ast.walk(tree_of(MODULES["servolink"]))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("servolink.")
        for alias in node.names
    }
    assert {name for _, name in seen} == set(servolink.__all__)
    for module, name in seen:
        assert getattr(servolink, name) is getattr(sys.modules[str(module)], name)


IMPORT_EACH = """
import importlib, json, sys, types

path, failures = sys.argv[1], {}
for module in json.loads(sys.argv[2]):
    for loaded in [name for name in sys.modules if name.partition(".")[0] == "servolink"]:
        del sys.modules[loaded]
    package = types.ModuleType("servolink")
    package.__path__ = [path]
    sys.modules["servolink"] = package
    try:
        importlib.import_module(module)
    except Exception as error:
        failures[module] = repr(error)
print(json.dumps(failures))
"""
"""Imports each module first of all, with an empty package around it that has imported nothing yet."""


def test_modules_that_need_extras_exist() -> None:
    assert NEEDED.keys() <= MODULES.keys()


@every(50)
def test_every_module_can_be_imported_first(step: int) -> None:
    left_out = not_importable()
    modules = [module for module in MODULES if "." in module and not module.endswith("__main__")]
    modules = [module for module in modules if module not in left_out]
    tried = [modules[at] for at in some(0, len(modules), step)]
    done = processes.run([sys.executable, "-c", IMPORT_EACH, str(PACKAGE), json.dumps(tried)], check=True)
    assert json.loads(done.stdout) == {}
