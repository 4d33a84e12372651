"""The processes of the benchmarks of fleets: a broker, and programs with boards."""

from __future__ import annotations

import os
import resource
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import IO, Any

MOSQUITTO = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
PER_PROCESS = 50
"""Boards of one process at most; a machine of a classroom has a few."""
_TICK, _PAGE = os.sysconf("SC_CLK_TCK"), resource.getpagesize()


@contextmanager
def broker() -> Iterator[str]:
    """Run mosquitto; yield its address."""
    with broker_process() as (url, _):
        yield url


@contextmanager
def broker_process(*lines: str) -> Iterator[tuple[str, int]]:
    """Run mosquitto, with more `lines` in its configuration; yield its address and the id of its process."""
    if MOSQUITTO is None:
        raise SystemExit("the benchmark of the fleet needs mosquitto: install it, for example with apt")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="servolink-broker-") as folder:
        config = Path(folder) / "mosquitto.conf"
        # Without the last line the broker collects small messages for up to 40 ms.
        # What it logs is not read: a line for each of thousands of connections would fill the pipe, and hold it up.
        always = ("allow_anonymous true", "set_tcp_nodelay true", "log_type error")
        text = (f"listener {port} 127.0.0.1", *always, *lines)
        config.write_text("\n".join(text) + "\n", encoding="ascii")
        process = subprocess.Popen([MOSQUITTO, "-c", str(config)], stderr=subprocess.PIPE, text=True)  # noqa: S603
        try:
            _wait_for(process, port)
            yield f"mqtt://127.0.0.1:{port}", process.pid
        finally:
            process.terminate()
            process.communicate()


def _wait_for(broker: subprocess.Popen[str], port: int) -> None:
    while broker.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        sleep(0.01)
    raise RuntimeError(f"the broker ended with {broker.returncode}")


@dataclass
class Process:
    """A process that is measured from outside."""

    pid: int

    @property
    def cpu(self) -> float:
        """CPU seconds that it has used."""
        fields = Path(f"/proc/{self.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICK

    @property
    def memory(self) -> float:
        """MB that it occupies."""
        return int(Path(f"/proc/{self.pid}/statm").read_text(encoding="ascii").split()[1]) * _PAGE / 1e6


def pipes(process: subprocess.Popen[str]) -> tuple[IO[str], IO[str]]:
    """Return the input and the output of a process of `started`."""
    assert process.stdin is not None  # noqa: S101 - they are pipes
    assert process.stdout is not None  # noqa: S101 - they are pipes
    return process.stdin, process.stdout


@contextmanager
def workers(url: str, count: int, hz: float) -> Iterator[None]:
    """Run `count` boards in several processes; yield when all boards have joined."""
    with ExitStack() as stack:
        found = []
        for first in range(0, count, PER_PROCESS):
            size = min(PER_PROCESS, count - first)
            arguments = ("benchmarks.fleet_worker", "boards", url, str(first), str(size), str(hz))
            found.append(stack.enter_context(started(*arguments)))
        for process in found:
            until_ready(process)
        yield


@contextmanager
def echo(url: str) -> Iterator[None]:
    """Run the bare program that echoes messages."""
    with started("benchmarks.fleet_worker", "echo", url) as process:
        until_ready(process)
        yield


@contextmanager
def started(module: str, *arguments: str, folder: str | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a module whose user has their files in `folder`, by default a new one; the end of its input ends it."""
    with tempfile.TemporaryDirectory(prefix="servolink-fleet-") as made:
        names = ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME")
        folders: dict[str, Any] = dict.fromkeys(names, folder or made)
        process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **folders},
        )
        try:
            yield process
        finally:
            pipes(process)[0].close()
            process.wait()


def until_ready(process: subprocess.Popen[str]) -> None:
    """Return when a process has printed `ready`. Raise SystemExit if it has ended before."""
    if pipes(process)[1].readline() != "ready\n":
        raise SystemExit("a process of the benchmark of the fleet has ended")
