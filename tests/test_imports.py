"""Imports go one way, and what promises to have no clock and no input or output imports neither."""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from servolink import api
from tests import processes

PACKAGE = Path(__file__).parents[1] / "servolink"
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}

MAY_IMPORT = {
    "errors": set[str](),
    "printable": set[str](),
    "atomic": set[str](),
    "reading": set[str](),
    "protocol": {"errors", "printable"},
    "project": {"atomic", "errors", "printable", "protocol"},
    "transports": {"errors", "printable", "reading"},
    "virtual": {"atomic", "errors", "printable", "protocol", "reading", "transports"},
    "discovery": {"atomic", "errors", "printable", "transports"},
    "client": {"errors", "printable", "protocol", "project", "transports", "discovery"},
    "doctor": {"errors", "printable", "protocol", "transports", "discovery", "client"},
    "cli": {"errors", "printable", "protocol", "project", "transports", "virtual", "discovery", "client", "doctor"},
    "__main__": {"cli"},
    "api": {"errors", "protocol", "project", "transports", "discovery", "client"},
    "": {"api"},
}
"""What each part of the package may import besides itself; "" is the package's own file, with the public names."""

MAY_IMPORT_IN_PROJECT = {
    "": set[str](),
    "files": {""},
    "checks": {"", "files"},
    "edits": {"", "checks"},
    "imports": {"", "files", "checks"},
}
"""The same for the folders within `project`; "" are its own files."""
LATE = ("servolink.project.model", "servolink.project.edits.build")
"""A project can be added to, which is an edit: imported when it is called."""

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
"""What a part that is told bytes and times, and tells bytes, has no use for."""
SERVING = {"bridge", "network", "pacemaker", "serving", "terminal", "transport", "usbip.server"}
"""The files of `virtual` that connect the board to the world; the others are the board."""


def part_of(module: str) -> str:
    """Return the part of the package that `module` belongs to, empty for the package itself."""
    return module.split(".")[1] if "." in module else ""


def imported(path: Path) -> Iterator[tuple[str, str]]:
    """Yield module and name of each import in a file, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: write imports in full"
            yield from ((node.module or "", alias.name) for alias in node.names)


def is_told_everything(module: str) -> bool:
    """Tell whether `module` gets bytes and times from outside and has no way to them itself."""
    return part_of(module) == "protocol" or (
        part_of(module) == "virtual" and module.removeprefix("servolink.virtual.") not in SERVING
    )


@pytest.mark.parametrize("module", MODULES)
def test_parts_import_only_what_lies_below_them(module: str) -> None:
    part = part_of(module)
    inside = {
        part_of(f"{source}.{name}" if source == "servolink" else source)
        for source, name in imported(MODULES[module])
        if source.partition(".")[0] == "servolink"
    }
    if part in {"cli", "__main__"}:
        inside -= {"", *api.__all__}  # commands may use what every program may
    assert inside <= {part} | MAY_IMPORT[part]


def folder_in_project(module: str) -> str:
    """Return the folder within `project` that a module of it belongs to, empty for its own files."""
    return module.split(".")[2] if module.count(".") > 2 or MODULES[module].name == "__init__.py" else ""


@pytest.mark.parametrize("module", [module for module in MODULES if module.startswith("servolink.project.")])
def test_folders_in_project_import_only_what_lies_below_them(module: str) -> None:
    sources = {
        source
        for source, _ in imported(MODULES[module])
        if source.startswith("servolink.project.") and (module, source) != LATE
    }
    folder = folder_in_project(module)
    assert {folder_in_project(source) for source in sources} <= {folder} | MAY_IMPORT_IN_PROJECT[folder]


def test_every_part_has_its_rule() -> None:
    assert {part_of(module) for module in MODULES} == set(MAY_IMPORT)


def test_every_serving_file_is_there() -> None:
    assert {f"servolink.virtual.{name}" for name in SERVING} <= set(MODULES)


@pytest.mark.parametrize("module", [module for module in MODULES if is_told_everything(module)])
def test_protocol_and_virtual_board_are_told_bytes_and_times(module: str) -> None:
    world = {(source, name) for source, name in imported(MODULES[module]) if source.partition(".")[0] in OUTSIDE_WORLD}
    if part_of(module) == "virtual":
        world.discard(("random", "Random"))  # with a seed, as the next test sees to
    assert not world


@pytest.mark.parametrize("module", MODULES)
def test_chance_has_a_seed(module: str) -> None:
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Random")
    ]
    assert {name for source, name in imported(MODULES[module]) if source == "random"} <= {"Random"}
    assert all(call.args for call in calls)


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


def test_every_module_can_be_imported_first() -> None:
    modules = [module for module in MODULES if "." in module and not module.endswith("__main__")]
    done = processes.run([sys.executable, "-c", IMPORT_EACH, str(PACKAGE), json.dumps(modules)], check=True)
    assert json.loads(done.stdout) == {}
