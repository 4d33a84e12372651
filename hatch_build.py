"""`SERVOLINK_COMPILE=1 pip install .` compiles the two loops that cost most; without it nothing is compiled.

See docs/how-to/compiled-build.md. `python hatch_build.py FOLDER` compiles without installing and prints the path.
"""

from __future__ import annotations

import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).parent
SOURCE = "servolink/protocol/_speedups.c"
MODULE = "servolink.protocol._speedups"


class NoCompiler(Exception):
    """Compiling failed; the text says what to do."""


class CompiledLoops(BuildHookInterface[Any]):
    """Adds the compiled module to a wheel, or to the source of an editable installation."""

    _built: tempfile.TemporaryDirectory[str] | None = None

    def dependencies(self) -> list[str]:
        """Return what is needed to build: nothing, for pure Python."""
        return ["setuptools>=65"] if self._wanted else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, if that is wanted."""
        if not self._wanted:
            return
        if version == "editable":
            compile_into(ROOT)
            return
        self._built = tempfile.TemporaryDirectory(prefix="servolink-")
        built = compile_into(Path(self._built.name))
        build_data["force_include"][str(built)] = f"{Path(SOURCE).parent.as_posix()}/{built.name}"
        build_data["infer_tag"] = True
        build_data["pure_python"] = False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what is in the wheel now."""
        if self._built is not None:
            self._built.cleanup()

    @property
    def _wanted(self) -> bool:
        return self.target_name == "wheel" and os.environ.get("SERVOLINK_COMPILE", "0") not in {"", "0"}


def compile_into(folder: Path) -> Path:
    """Compile the module into `folder`, at its place in the package, and return its file; NoCompiler if that fails."""
    setuptools, errors = import_module("setuptools"), import_module("setuptools.errors")
    optimized = [] if sys.platform == "win32" else ["-O3"]
    module = setuptools.Extension(MODULE, [str(ROOT / SOURCE)], extra_compile_args=optimized)
    command = setuptools.Distribution({"name": "servolink", "ext_modules": [module]}).get_command_obj("build_ext")
    with tempfile.TemporaryDirectory(prefix="servolink-") as objects:
        command.build_lib, command.build_temp = str(folder), objects
        command.ensure_finalized()
        try:
            command.run()
        except (errors.BaseError, errors.CCompilerError) as error:
            raise NoCompiler(
                f"cannot compile {SOURCE}: {error}. Install a C compiler and Python's headers (Debian: gcc "
                "python3-dev), or leave SERVOLINK_COMPILE unset: pure Python does the same."
            ) from error
    return Path(command.get_ext_fullpath(MODULE))


if __name__ == "__main__":
    try:
        sys.stdout.write(f"{compile_into(Path(sys.argv[1]))}\n")
    except NoCompiler as fault:
        sys.exit(str(fault))
