"""Plain mutation: seeds changed at random, without feedback from the program."""

from __future__ import annotations

from random import Random

_TOKENS = (
    b"\x13\x4c\x05\x1d",
    b"\0" * 4,
    b"\xff\xff",
    b"\x7f\xff",
    b"\x80\0",
    b"%00",
    b"\\ud800",
    b"\xed\xb2\x80",
    b"\xe2\x80\xae",
    b"\x1b[2J",
    b"\xc2\x9b",
    b'"',
    b"1e999",
    b"-1",
    b"99999999999999999999",
    b"[[",
    b"}",
    b"&",
    b"=",
    b"://",
)
"""Byte sequences that random bytes hardly ever hit."""


class Mutations:
    """An endless source of inputs, reproducible by its seed."""

    def __init__(self, seeds: tuple[bytes, ...], longest: int, seed: int) -> None:
        """Mutate `seeds` into inputs of at most `longest` bytes."""
        self._seeds = seeds
        self._longest = longest
        self._random = Random(seed)

    def next(self) -> bytes:
        """Return the next input."""
        random, draw = self._random.random, self._draw
        if random() < 0.15:
            return self._random.randbytes(draw(self._longest))
        data = bytearray(self._seeds[draw(len(self._seeds))])
        while True:
            self._change(data, draw(8))
            if random() < 0.5:
                return bytes(data[: self._longest])

    def _draw(self, below: int) -> int:
        return int(self._random.random() * below)

    def _change(self, data: bytearray, kind: int) -> None:
        draw = self._draw
        at = draw(len(data) + 1)
        if kind < 3 and at < len(data):
            data[at] = draw(256) if kind < 2 else data[at] ^ 1 << draw(8)
        elif kind == 3:
            del data[at : at + 1 + draw(12)]
        elif kind == 4:
            data[at:at] = self._random.randbytes(1 + draw(8))
        elif kind == 5:
            data[at:at] = _TOKENS[draw(len(_TOKENS))]
        elif kind == 6:
            data[at:at] = data[draw(len(data) + 1) :][: 1 + draw(24)]
        else:
            other = self._seeds[draw(len(self._seeds))]
            data[at:] = other[draw(len(other) + 1) :]
