"""Virtual time with one device: what it brings lies ready until the loop reads it, as in the buffer of a system."""

from __future__ import annotations

import os
import selectors
from collections import deque
from collections.abc import Callable

from tests.virtual_time import VirtualTimeLoop


class Deadlock(RuntimeError):
    """Somebody waits for what cannot come any more."""


class SimulatedLoop(VirtualTimeLoop):
    """An event loop without system calls; time jumps to the next timer or to the next bytes of the device.

    A loop that was stalled reads first what has come meanwhile and runs its timers then, as every event loop does.
    """

    def __init__(self) -> None:
        """Begin at a time that is not zero, with a silent device."""
        self.coming: deque[tuple[float, bytes]] = deque()
        self._device = os.pipe()  # a descriptor that can be registered; nothing is written to it
        super().__init__(_DeviceSelector)

    def bring(self, when: float, data: bytes) -> None:
        """Let the device have `data` ready at that time; times never decrease."""
        self.coming.append((when, data))

    def read_device(self, receive: Callable[[bytes], None]) -> None:
        """Call `receive` with what has come, one piece in a turn of the loop."""
        self.add_reader(self._device[0], lambda: receive(self.coming.popleft()[1]))

    def ready(self) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what a selector reports when the device can be read."""
        return [(self._selector.get_key(self._device[0]), selectors.EVENT_READ)]  # type: ignore[attr-defined]

    def close(self) -> None:
        """Close the loop and its descriptor."""
        if not self.is_closed():
            for end in self._device:
                os.close(end)
        super().close()


class _DeviceSelector(selectors.DefaultSelector):
    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        assert isinstance(loop, SimulatedLoop)
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        loop = self._loop
        if loop.coming:
            due = loop.coming[0][0]
            if timeout is None or due <= loop.now + timeout:
                loop.now = max(loop.now, due)
                return loop.ready()
        if timeout is None:
            raise Deadlock("nothing is ready, nothing is timed, and the program still waits")
        loop.now += timeout
        return []
