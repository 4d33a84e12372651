"""Fault injection on a line: the same seed and the same bytes give the same faults."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Awaitable
from random import Random

from msgspec import Struct

from servolink.errors import ConnectionLost, InvalidAddress, quote
from servolink.support import call_at
from servolink.transports.address import Address, shorten
from servolink.transports.base import Transport
from servolink.transports.foreign import contained
from servolink.transports.lifecycle import WrappedTransport


class Faults(Struct, frozen=True):
    """Rates of faults on a line, mostly probabilities 0..1, and also the names of options in addresses and `parse`."""

    drop: float = 0.0
    """Probability, per byte, of being lost."""
    flip: float = 0.0
    """Probability, per byte, of an inverted bit."""
    insert: float = 0.0
    """Probability, per byte, of a random byte inserted in front."""
    delay: float = 0.0
    """Probability, per chunk, of arriving `delay_time` late, with all later chunks behind."""
    delay_time: float = 0.05
    """Delay of a late chunk, in seconds."""
    duplicate: float = 0.0
    """Probability, per chunk, of being delivered twice."""
    cut: float = 0.0
    """Probability, per chunk, of being cut anywhere before the last byte."""
    unplug: int = 0
    """Bytes in one direction after which the line is lost; 0 for never."""

    @classmethod
    def parse(cls, text: str) -> Faults:
        """Return the faults in a text such as `drop=0.01,flip=0.001`. Raise InvalidAddress, with the valid names."""
        url = "faults://?" + text.replace(",", "&")
        try:
            address = Address.parse(url)
            faults = cls.from_address(address)
        except InvalidAddress as error:
            raise InvalidAddress(str(error).removeprefix(f"{shorten(url)}: ").removeprefix("option ")) from None
        names = cls.__struct_fields__
        for name in (*address.options, *address.connection_options):
            if name not in names:
                raise InvalidAddress(f"{quote(shorten(name))} is not a fault; the faults are {', '.join(names)}")
        return faults

    @classmethod
    def from_address(cls, address: Address) -> Faults:
        """Return the faults among the options of `address`; the caller refuses other options."""
        return cls(
            drop=address.number("drop", 0.0, 0.0, 1.0),
            flip=address.number("flip", 0.0, 0.0, 1.0),
            insert=address.number("insert", 0.0, 0.0, 1.0),
            delay=address.number("delay", 0.0, 0.0, 1.0),
            delay_time=address.number("delay_time", 0.05, 0.0, 3600.0),
            duplicate=address.number("duplicate", 0.0, 0.0, 1.0),
            cut=address.number("cut", 0.0, 0.0, 1.0),
            unplug=address.integer("unplug", 0, 0, 10**15),
        )


class LineFaults:
    """Faults in one direction of a bad line."""

    def __init__(self, faults: Faults, seed: int | str = 0) -> None:
        """Draw all faults from a random generator with `seed`."""
        self._faults = faults
        self._random = Random(seed)  # noqa: S311 - repeatable, not secret
        self._passed = 0
        self._last = -math.inf
        # Probability of at least one byte fault among three independent kinds.
        self._noise = 1 - (1 - faults.drop) * (1 - faults.flip) * (1 - faults.insert)
        self._clean = self._clean_run()

    @property
    def unplugged(self) -> bool:
        """Whether the line is permanently lost."""
        return 0 < self._faults.unplug <= self._passed

    def apply(self, chunk: bytes, now: float) -> list[tuple[float, bytes]]:
        """Return arrival time and content of each piece of `chunk`, sent at `now` seconds, in order."""
        chunk = self._count(chunk)
        if chunk and self._happens(self._faults.cut):
            chunk = chunk[: self._random.randrange(len(chunk))]
        if self._noise:
            chunk = self._noisy(chunk)
        if not chunk:
            return []
        if self._happens(self._faults.delay):
            now += self._faults.delay_time
        self._last = max(self._last, now)
        return [(self._last, chunk)] * (2 if self._happens(self._faults.duplicate) else 1)

    def _count(self, chunk: bytes) -> bytes:
        if self._faults.unplug:
            chunk = chunk[: self._faults.unplug - self._passed]
        self._passed += len(chunk)
        return chunk

    def _happens(self, probability: float) -> bool:
        return probability > 0 and self._random.random() < probability

    def _clean_run(self) -> int:
        """Return the number of bytes before the next byte fault, from a single draw instead of a draw for each byte."""
        if not 0 < self._noise < 1:
            return 0
        return int(math.log(1 - self._random.random()) / math.log1p(-self._noise))

    def _noisy(self, chunk: bytes) -> bytes:
        out = bytearray()
        at = 0
        while at + self._clean < len(chunk):
            out += chunk[at : at + self._clean]
            at += self._clean
            self._damage(out, chunk[at])
            at += 1
            self._clean = self._clean_run()
        self._clean -= len(chunk) - at
        return bytes(out + chunk[at:])

    def _damage(self, out: bytearray, byte: int) -> None:
        """Append a byte with at least one fault, or drop the byte."""
        faults = self._faults
        # At least one fault happens: a draw below the joint probability decides on the first among insert, flip and
        # drop, in this order. Later kinds are drawn separately, earlier kinds did not happen.
        draw = self._random.random() * self._noise
        insert = draw < faults.insert
        flip = self._happens(faults.flip) if insert else draw < faults.insert + (1 - faults.insert) * faults.flip
        drop = self._happens(faults.drop) if insert or flip else True
        if insert:
            out.append(self._random.randrange(256))
        if not drop:
            out.append(byte ^ (1 << self._random.randrange(8)) if flip else byte)


MAX_LATE = 128 * 1024
"""Most late bytes in one direction; beyond this number sending waits, as on any slow line."""

_UNPLUGGED = "unplugged by fault injection"


class _LateChunks:
    """Queue of late chunks in one direction, with arrival times."""

    def __init__(self) -> None:
        self.room = asyncio.Event()
        """Set while fewer than MAX_LATE bytes are late."""
        self._chunks: deque[tuple[float, bytes]] = deque()
        self.size = 0
        """Number of late bytes in this direction."""
        self._count(0)

    def __bool__(self) -> bool:
        return bool(self._chunks)

    @property
    def first(self) -> tuple[float, bytes]:
        return self._chunks[0]

    def append(self, at: float, chunk: bytes) -> None:
        self._chunks.append((at, chunk))
        self._count(len(chunk))

    def popleft(self) -> bytes:
        _, chunk = self._chunks.popleft()
        self._count(-len(chunk))
        return chunk

    def clear(self) -> None:
        self._chunks.clear()
        self._count(-self.size)

    def _count(self, change: int) -> None:
        self.size += change
        if self.size < MAX_LATE:
            self.room.set()
        else:
            self.room.clear()


class FaultyTransport(WrappedTransport):
    """Transport with faults in one or both directions; a delayed chunk also delays all later chunks."""

    def __init__(
        self, inner: Transport, faults: Faults, *, seed: int = 0, sent: bool = True, received: bool = True
    ) -> None:
        """Wrap `inner`; each direction draws separate faults from `seed`."""
        super().__init__(contained(inner))
        self._down = LineFaults(faults if sent else Faults(), f"sent {seed}")
        self._up = LineFaults(faults if received else Faults(), f"received {seed}")
        self._late_down = _LateChunks()
        self._late_up = _LateChunks()
        self._sending: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def late_bytes(self) -> int:
        """Number of late bytes in both directions."""
        return self._late_down.size + self._late_up.size

    def data(self, chunk: bytes, /) -> None:
        """Apply faults to `chunk` and pass on the result."""
        now = asyncio.get_running_loop().time()
        for at, piece in self._up.apply(chunk, now):
            if self._late_up or at > now:
                self._late_up.append(at, piece)
            else:
                self._deliver(piece)
        self._arm()
        if self._up.unplugged:
            self._break(_UNPLUGGED)

    def _send(self, data: bytes) -> Awaitable[None] | None:
        """Apply faults to `data` and send the result; delayed pieces count as sent, as long as there is room."""
        now = asyncio.get_running_loop().time()
        pieces = self._down.apply(data, now)
        taking: Awaitable[None] | None = None
        if self._late_down or any(at > now for at, _ in pieces):
            for at, piece in pieces:
                self._late_down.append(at, piece)
            if pieces and (self._sending is None or self._sending.done()):
                self._sending = asyncio.ensure_future(self._send_late())
        elif pieces or not data:
            taking = super()._send(b"".join(piece for _, piece in pieces))
        has_room = self._late_down.room.is_set() and self._late_up.room.is_set()
        return None if taking is None and has_room and not self._down.unplugged else self._until_room(taking)

    async def _until_room(self, taking: Awaitable[None] | None) -> None:
        if taking is not None:
            await taking
        if self._down.unplugged:
            self._break(_UNPLUGGED)
            raise self._lost()
        for late in (self._late_down, self._late_up):
            await late.room.wait()

    async def _close(self) -> None:
        self._forget_late()  # delayed pieces are lost
        await super()._close()

    def _abort(self) -> None:
        self._forget_late()
        super()._abort()

    async def _send_late(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            while self._late_down:
                at, piece = self._late_down.first  # removed only when sent, so that no later piece overtakes
                await asyncio.sleep(at - loop.time())
                await self._late_up.room.wait()  # a request of a few bytes can cause a response of 64 KiB
                await self._inner.send(piece)
                self._late_down.popleft()
        except ConnectionLost:
            self._late_down.clear()  # the wrapped transport reports the loss

    def _arm(self) -> None:
        if self._late_up and self._timer is None:
            self._timer = call_at(asyncio.get_running_loop(), self._late_up.first[0], self._release)

    def _release(self) -> None:
        self._timer = None
        due, _ = self._late_up.first
        now = max(due, asyncio.get_running_loop().time())  # a timer may fire early by a rounding error
        while self._late_up and self._late_up.first[0] <= now:
            self._deliver(self._late_up.popleft())
        self._arm()

    def _forget_late(self) -> None:
        if self._sending is not None:
            self._sending.cancel()
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        self._late_down.clear()
        self._late_up.clear()
