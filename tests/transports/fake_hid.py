"""A board where hidapi would find one, which can be unplugged, deaf and stuck at any time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

VENDOR_DESCRIPTOR = bytes.fromhex("0600ff0901a101150026ff00750895400901810209029102c0")
"""Usage page 0xFF00, one input and one output report of 64 bytes, no ids."""
KERNEL_QUEUE = 63  # reports that Linux keeps for a reader; later ones are lost
HASTE = 50.0  # waiting for nothing takes this much less time than on a real device


class FakeHid:
    """Stands for the module and for the one device it has; the far end is in the test's hand."""

    def __init__(self, node: Path, descriptor: bytes = VENDOR_DESCRIPTOR) -> None:
        self.node = node
        self.descriptor = descriptor
        self.entry: dict[str, Any] = {
            "path": str(node).encode(),
            "vendor_id": 0x1209,
            "product_id": 0x0001,
            "serial_number": "SN 1",
            "manufacturer_string": "Acme",
            "product_string": "Servo board",
            "usage_page": 0xFF00,
            "usage": 1,
            "interface_number": 2,
        }
        self.entries = [self.entry]
        self.heard: Callable[[bytes], None] = lambda report: None  # called with each report that the board takes
        self.change = threading.Condition()
        self.reports: deque[bytes] = deque()
        self.lost = 0  # reports for which there was no room
        self.there = True
        self.haste = HASTE
        self.deaf = False
        self.read_stuck = False
        self.read_is_stuck = False  # whether one is by now
        self.write_is_stuck = False
        self.refused = False  # whether a write fails
        self.handles: set[FakeHandle] = set()  # the open ones
        self.misuse: list[str] = []
        self.threads: set[int] = set()  # that have opened, read or closed
        node.touch()

    def enumerate(self) -> list[dict[str, Any]]:
        return self.entries if self.there else []

    def device(self) -> FakeHandle:
        return FakeHandle(self)

    @property
    def ready(self) -> bool:
        """Whether there is something that ends a read."""
        return not self.there or bool(self.reports and not self.read_stuck)

    def bring(self, report: bytes) -> None:
        """Send a report to the program, if there is room for it."""
        with self.change:
            if len(self.reports) < KERNEL_QUEUE:
                self.reports.append(report)
            else:
                self.lost += 1
            self.change.notify_all()

    def set(self, **states: bool) -> None:
        """Change how the board behaves, also for calls that are under way."""
        with self.change:
            vars(self).update(states)
            self.change.notify_all()

    def unplug(self) -> None:
        self.set(there=False, deaf=False, read_stuck=False)


class FakeHandle:
    """An hidapi device."""

    def __init__(self, hid: FakeHid) -> None:
        self._hid = hid
        self._busy = 0

    def open_path(self, path: bytes) -> None:
        self._hid.threads.add(threading.get_ident())
        if not self._hid.there or path != self._hid.entry["path"]:
            raise OSError("open failed")
        self._hid.handles.add(self)

    def get_report_descriptor(self) -> Sequence[int]:
        return list(self._hid.descriptor)

    def read(self, max_length: int, timeout_ms: int) -> Sequence[int]:
        hid = self._hid
        hid.threads.add(threading.get_ident())
        if timeout_ms <= 0 or self not in hid.handles:
            hid.misuse.append("read without a limit or an open device")
        with hid.change:
            self._busy += 1
            hid.change.wait_for(lambda: hid.ready, timeout_ms / 1000 / hid.haste)
            hid.read_is_stuck = hid.read_stuck
            hid.change.wait_for(lambda: not hid.read_stuck)
            self._busy -= 1
            if not hid.there:
                raise OSError("read error")
            return list(hid.reports.popleft()[:max_length]) if hid.reports else []

    def write(self, report: bytes) -> int:
        hid = self._hid
        if self not in hid.handles:
            hid.misuse.append("write without an open device")
        with hid.change:
            self._busy += 1
            hid.write_is_stuck = hid.deaf
            hid.change.wait_for(lambda: not hid.deaf)
            self._busy -= 1
            if not hid.there or hid.refused:
                return -1
        hid.heard(report)
        return len(report)

    def error(self) -> str:
        return "No such device"

    def close(self) -> None:
        self._hid.threads.add(threading.get_ident())
        if self._busy:
            self._hid.misuse.append("closed during another call")
        self._hid.handles.discard(self)
