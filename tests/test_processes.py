"""Programs that tests start end with their test, with all that they started, even where the tests are killed."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests import processes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="process groups are those of Unix")

ROOT = Path(__file__).parents[1]
PARENT = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
print(child.pid, flush=True)
child.wait()
"""
"""A program with a program of its own."""

KILLED = f"""
import os, signal, sys
from tests import processes
program = processes.start([sys.executable, "-c", {PARENT!r}], stderr=None)
print(program.stdout.readline().strip(), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
"""What pytest is when it is killed."""


def read_to_the_end(pipe: int) -> None:
    """Return when nobody holds the other end any more."""
    while os.read(pipe, 1024):
        pass


def test_what_a_test_leaves_is_ended_with_all_that_it_started() -> None:
    reading, writing = os.pipe()
    with processes.sessions.ending():
        program = processes.start([sys.executable, "-c", PARENT], stderr=writing)
        os.close(writing)
        assert program.stdout is not None
        assert int(program.stdout.readline())
    assert program.returncode == -signal.SIGKILL
    read_to_the_end(reading)  # the program's own program had it too
    os.close(reading)


def test_nothing_is_left_of_tests_that_are_killed() -> None:
    reading, writing = os.pipe()
    killed = processes.start([sys.executable, "-c", KILLED], cwd=ROOT, stderr=writing)
    os.close(writing)
    processes.finish(killed)
    assert killed.returncode == -signal.SIGKILL
    read_to_the_end(reading)
    os.close(reading)


def test_programs_can_be_interrupted() -> None:
    program = processes.start([sys.executable, "-c", "print('here', flush=True); input()"], stdin=subprocess.PIPE)
    assert program.stdout is not None
    assert program.stdout.readline() == "here\n"
    processes.finish(program, signal.SIGINT)
    assert program.returncode == -signal.SIGINT


@pytest.mark.slow
def test_programs_can_be_interrupted_where_the_tests_cannot() -> None:
    one = f"{__file__}::{test_programs_can_be_interrupted.__name__}"
    quiet = ("-p", "no:cacheprovider", "-o", "filterwarnings=default")  # pytest may leave something open itself
    command = shlex.join([sys.executable, "-m", "pytest", "--numprocesses=0", *quiet, one])
    shell = f"unset PYTEST_ADDOPTS; trap '' INT; exec {command}"  # options such as --cov are for the whole run
    ran = processes.run(["/bin/sh", "-c", shell], cwd=ROOT)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "1 passed" in ran.stdout


def test_programs_are_started_there_only() -> None:
    starting = re.compile(r"subprocess\.(run|call|check_\w+|Popen)\(|create_subprocess_")
    sources = set((ROOT / "tests").rglob("*.py")) - set((ROOT / "tests/kernel/guest").iterdir())  # ends with its kernel
    found = {path.relative_to(ROOT).as_posix() for path in sources if starting.search(path.read_text(encoding="utf-8"))}
    assert found == {"tests/processes.py", "tests/test_processes.py"}
