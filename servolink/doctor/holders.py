"""Which other program has the device open."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from servolink.doctor.facts import Process, SystemFacts
from servolink.doctor.finding import Finding
from servolink.doctor.nodes import device_nodes, device_of
from servolink.printable import printable

_SERVERS_OF_TERMINALS = {"/dev/ptmx", "/dev/pts/ptmx"}


def check_holders(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find programs that have the device of `url` open, as far as this user may see them."""
    nodes = {path for path in device_nodes(facts, url) if not device_of(url) or _is_terminal(facts, path)}
    if not nodes:
        return
    for process in facts.processes():
        for path in sorted(nodes & process.files):
            if process.pid != facts.pid and not _serves(process, path):
                yield Finding(
                    "in use",
                    f"process {process.pid} ({process.name or 'unknown'}) has {printable(path)} open",
                    "two programs on one port take each other's bytes, and most ports let in only one",
                    f"close it, or: kill {process.pid}",
                )


def _is_terminal(facts: SystemFacts, path: str) -> bool:
    """Tell whether `path` may be a serial port: nobody need close what every program has open, such as /dev/null."""
    terminals = facts.names("/sys/class/tty")
    return not terminals or path.startswith("/dev/pts/") or PurePosixPath(path).name in terminals


def _serves(process: Process, path: str) -> bool:
    """Tell whether `process` is the other end of a pseudo-terminal: it may hold both, as our virtual board does."""
    return path.startswith("/dev/pts/") and bool(process.files & _SERVERS_OF_TERMINALS)
