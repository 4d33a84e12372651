"""Run functions of the page in Node.js, so that they can be compared with those of the package."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests import processes

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")

_RUNNER = Path(__file__).with_name("web_runner.mjs")


def call_all(calls: list[tuple[str, str, list[Any]]]) -> list[Any]:
    """Return the results of functions of the page, each given as module, name and arguments."""
    assert NODE is not None
    command = [NODE, "--experimental-default-type=module", str(_RUNNER)]
    done = processes.run(command, json.dumps(calls))
    assert done.returncode == 0, done.stderr
    results: list[Any] = json.loads(done.stdout)
    return results
