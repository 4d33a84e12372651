"""A real broker: mosquitto, on a free port of this machine."""

from __future__ import annotations

import shutil
import signal
import socket
import subprocess
import weakref
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.processes import finish, start

FOUND = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin:/usr/local/bin:/opt/homebrew/sbin")

needs_broker = [
    pytest.mark.broker,
    pytest.mark.skipif(FOUND is None, reason="mosquitto is not installed"),
]
"""What `pytestmark` of a module with a broker is."""

OPEN = ("allow_anonymous true",)
"""The configuration of a broker that lets everybody in."""


class Broker:
    """A broker that can be ended and started again."""

    def __init__(self, folder: Path, lines: Iterable[str] = OPEN, listener: Iterable[str] = ()) -> None:
        """Have it configured with `lines`; `listener` configures its port."""
        reserved = socket.socket()  # keeps the port, also while the broker is away, from anybody who does not reuse it
        reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        reserved.bind(("127.0.0.1", 0))
        weakref.finalize(self, reserved.close)
        self.port: int = reserved.getsockname()[1]
        self._config = folder / "mosquitto.conf"
        self._log = folder / "mosquitto.log"
        # As root, or it would change to a user that cannot read the files of the test.
        text = [f"listener {self.port} 127.0.0.1", *listener, *lines, "user root", "log_type all", "log_dest stderr"]
        self._config.write_text("\n".join(text) + "\n", encoding="utf-8")
        self._config.chmod(0o644)
        self._process: subprocess.Popen[str] | None = None

    @property
    def url(self) -> str:
        """The address of the broker."""
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start it, and return when it serves: one that only listens still loses a signal that ends it."""
        assert FOUND is not None
        with open(self._log, "a+", encoding="utf-8") as log:
            end = log.seek(0, 2)
            self._process = start([FOUND, "-c", str(self._config)], stderr=log)
            while " running" not in self._log.read_text(encoding="utf-8")[end:]:
                assert self._process.poll() is None, self._log.read_text(encoding="utf-8")
        with socket.create_connection(("127.0.0.1", self.port)) as program:
            program.shutdown(socket.SHUT_WR)
            while program.recv(64):  # with TLS, an alert comes first
                pass

    def end(self, by: signal.Signals = signal.SIGTERM) -> None:
        """End it."""
        if self._process is not None:
            finish(self._process, by)
            self._process = None

    def pause(self, *, paused: bool = True) -> None:
        """Stop it as a machine that stands still, or let it go on."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP if paused else signal.SIGCONT)

    def log(self) -> str:
        """Return what it has logged."""
        return self._log.read_text(encoding="utf-8")
