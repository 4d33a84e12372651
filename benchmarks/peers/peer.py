"""What a benchmark needs of a parser: frames of its own format, and where to put the bytes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from random import Random
from typing import Any, ClassVar, Literal

SIZES = (14, 186)
"""Frame sizes in bytes that every parser comes as near to as its format allows."""

Feeding = Literal["chunks", "frames", "stream"]


class Peer(ABC):
    """A parser of one library, at the beginning of a stream. What it raises on bad bytes, its file catches."""

    name: ClassVar[str]
    package: ClassVar[str] = ""
    """What is installed to have it; empty if it comes with servolink."""
    work: ClassVar[str]
    """What it does for each frame."""
    resync: ClassVar[str]
    """Where it goes on behind bytes that are no frame."""
    validates: ClassVar[bool] = True
    """Whether a damaged frame is noticed by a checksum."""
    builds: ClassVar[bool] = False
    """Whether it makes an object with the fields of each frame."""
    compiled: ClassVar[bool] = False
    """Whether the loop over the bytes is in C."""
    fairness: ClassVar[str]
    """Where the comparison is unequal: what is to the advantage of which side."""
    feeding: ClassVar[Feeding] = "chunks"
    """Chunks of any size; one frame a call, which some need; or it reads from a stream that is there as a whole."""

    @staticmethod
    @abstractmethod
    def frame(size: int, number: int) -> bytes | None:
        """Return a frame of about `size` bytes that no other number has, None if the format has no such size."""

    @abstractmethod
    def feed(self, chunk: bytes) -> list[Any]:
        """Take the next bytes of the stream and return the frames that are now complete."""

    @abstractmethod
    def content(self, frame: Any) -> bytes:
        """Return what tells a returned frame from the others."""


def content(size: int, number: int) -> bytes:
    """Return `size` random bytes that begin with `number`, as far as there is room."""
    return (number.to_bytes(2, "little") + Random(number).randbytes(size))[:size]
