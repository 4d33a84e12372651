"""Runs servolink in a process from which a script has taken what another system lacks: COMMAND..., or `-m MODULE`.

`--import` imports all modules, and `--all` runs several commands, given as JSON.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import pkgutil
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def run_as(take_away: Callable[[], None], script: str, encoding: str) -> int:
    """Take away what the other system lacks, and do what the command line says; files are written in `encoding`.

    Python programs that servolink starts run `script` too.
    """
    take_away()
    _change_programs(script)
    sys.path[0] = str(Path(__file__).parents[2])
    match sys.argv[1:]:
        case ["--import"]:
            print(json.dumps(import_all()))
        case ["--all", commands]:
            print(json.dumps(run_all(json.loads(commands), encoding)))
        case ["-m", module, *arguments]:
            sys.argv = [module, *arguments]
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        case arguments:
            from servolink.__main__ import main

            sys.argv = ["servolink", *arguments]
            return main()
    return 0


def _change_programs(script: str) -> None:
    real = subprocess.Popen.__init__

    def start(self: Any, args: Any, *rest: Any, **options: Any) -> None:
        if [*args][:2] == [sys.executable, "-m"]:
            args = [sys.executable, script, *args[1:]]
        real(self, args, *rest, **options)

    setattr(subprocess.Popen, "__init__", start)  # noqa: B010 - not of the same type


def import_all() -> dict[str, str]:
    """Import all modules of servolink; return those that fail, and why."""
    import servolink
    from tests.extras import not_importable

    failures, left_out = {}, not_importable()
    for module in pkgutil.walk_packages(servolink.__path__, "servolink."):
        if module.name not in left_out and not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except Exception as error:  # noqa: BLE001 - a module can fail in any way
                failures[module.name] = repr(error)
    return failures


def run_all(commands: list[list[str]], encoding: str) -> list[tuple[int, str, str]]:
    """Run commands one after the other, into files; return codes and outputs."""
    from servolink.__main__ import main

    said = []
    for command in commands:
        streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\n") for _ in range(2)]
        with contextlib.redirect_stdout(streams[0]), contextlib.redirect_stderr(streams[1]):
            try:
                code = main(command)
            except SystemExit as ended:
                code = int(ended.code or 0)
        for stream in streams:
            stream.seek(0)
        said.append((code, streams[0].read(), streams[1].read()))
    return said
