"""The package with and without its compiled loops, in one process."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from servolink.protocol import speedups as compiled
from servolink.protocol.layout import layout

_BUILD = Path(__file__).parents[1] / "hatch_build.py"
_MODULE = "servolink.protocol._speedups"


def loops() -> tuple[ModuleType | None, str]:
    """Return the compiled loops, made now if they are not installed, and how they came, or why there are none."""
    try:
        return import_module(_MODULE), "as installed"
    except ImportError:
        pass
    with tempfile.TemporaryDirectory() as folder:
        # A process of its own, because setuptools changes the one that it is in.
        done = subprocess.run(  # noqa: S603 - our own program
            [sys.executable, _BUILD, folder], capture_output=True, text=True, check=False
        )
        if done.returncode:
            return None, done.stderr.strip().rpartition("\n")[2]
        return _loaded(Path(done.stdout.strip().rpartition("\n")[2])), "compiled for this run"


def _loaded(built: Path) -> ModuleType:
    found = spec_from_file_location(_MODULE, built)
    if found is None or found.loader is None:
        raise ImportError(f"{built} is no module")
    module = module_from_spec(found)
    found.loader.exec_module(module)
    return module


def use(module: ModuleType | None) -> None:
    """Let new parsers and codecs use these compiled loops, or (None) Python's."""
    compiled.collect = None if module is None else module.collect
    compiled.read_rows = None if module is None else module.read_rows
    layout.cache_clear()


@contextmanager
def using(module: ModuleType | None) -> Iterator[None]:
    """Do so for a while."""
    before = compiled.collect, compiled.read_rows
    use(module)
    try:
        yield
    finally:
        compiled.collect, compiled.read_rows = before
        layout.cache_clear()
