"""The processes of the benchmark of the fleet: a broker, and programs with boards."""

from __future__ import annotations

import json
import os
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


@contextmanager
def broker() -> Iterator[str]:
    """Run mosquitto; yield its address."""
    if MOSQUITTO is None:
        raise SystemExit("the benchmark of the fleet needs mosquitto: install it, for example with apt")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="servolink-broker-") as folder:
        config = Path(folder) / "mosquitto.conf"
        # Without the last line the broker collects small messages for up to 40 ms.
        config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\n", encoding="ascii")
        process = subprocess.Popen([MOSQUITTO, "-c", str(config)], stderr=subprocess.PIPE, text=True)  # noqa: S603
        try:
            _wait_for(process, port)
            yield f"mqtt://127.0.0.1:{port}"
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
class Worker:
    """A process with boards."""

    process: subprocess.Popen[str]
    boards: int

    def used(self) -> dict[str, float]:
        """Return the CPU seconds and the bytes of memory that it has used."""
        stdin, stdout = _pipes(self.process)
        stdin.write("\n")
        stdin.flush()
        found: dict[str, float] = json.loads(stdout.readline())
        return found


def _pipes(process: subprocess.Popen[str]) -> tuple[IO[str], IO[str]]:
    assert process.stdin is not None  # noqa: S101 - they are pipes
    assert process.stdout is not None  # noqa: S101 - they are pipes
    return process.stdin, process.stdout


@contextmanager
def workers(url: str, count: int, hz: float) -> Iterator[list[Worker]]:
    """Run `count` boards in several processes; yield the processes, when all boards have joined."""
    with ExitStack() as stack:
        found = []
        for first in range(0, count, PER_PROCESS):
            size = min(PER_PROCESS, count - first)
            arguments = ("boards", url, str(first), str(size), str(hz))
            found.append(Worker(stack.enter_context(_started(*arguments)), size))
        for worker in found:
            _until_ready(worker.process)
        yield found


@contextmanager
def echo(url: str) -> Iterator[None]:
    """Run the bare program that echoes messages."""
    with _started("echo", url) as process:
        _until_ready(process)
        yield


@contextmanager
def _started(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    with tempfile.TemporaryDirectory(prefix="servolink-fleet-") as folder:
        folders: dict[str, Any] = dict.fromkeys(("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"), folder)
        process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-m", "benchmarks.fleet_worker", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **folders},
        )
        try:
            yield process
        finally:
            _pipes(process)[0].close()
            process.wait()


def _until_ready(process: subprocess.Popen[str]) -> None:
    if _pipes(process)[1].readline() != "ready\n":
        raise SystemExit("a process of the benchmark of the fleet has ended")
