"""construct: servolink's format, declared."""

from __future__ import annotations

from importlib import import_module
from io import BytesIO
from typing import Any

from benchmarks.peers.ours import typical
from benchmarks.peers.peer import Peer
from servolink.protocol.frame import MAGIC, encode_frame

_construct = import_module("construct")
_FRAME = _construct.Struct(
    "body"
    / _construct.RawCopy(
        _construct.Struct(
            "magic" / _construct.Const(MAGIC),
            "packet_id" / _construct.Int16ul,
            "content" / _construct.Prefixed(_construct.Int16ul, _construct.GreedyBytes),
        )
    ),
    "checksum" / _construct.Checksum(_construct.Byte, lambda data: sum(data) & 0xFF, _construct.this.body.data),
)


class Construct(Peer):
    """A declared frame, and around it the buffer that construct does not have."""

    name = "construct"
    package = "construct"
    work = "our format: magic, checksum; container object"
    fairness = "ours: it interprets a declaration and is not made for speed"
    resync = "one byte further (by the caller)"
    builds = True
    frame = staticmethod(typical)

    def __init__(self) -> None:
        """Begin a stream."""
        self._held = b""

    def feed(self, chunk: bytes) -> list[Any]:
        """Parse at each place where a frame may begin."""
        data, at, frames = self._held + chunk, 0, []
        stream = BytesIO(data)
        while (at := data.find(MAGIC[0], at)) >= 0:
            stream.seek(at)
            try:
                frames.append(_FRAME.parse_stream(stream))
            except _construct.StreamError:  # the rest is to come
                break
            except _construct.ConstructError:
                at += 1
            else:
                at = stream.tell()
        self._held = data[at:] if at >= 0 else b""
        return frames

    def content(self, frame: Any) -> bytes:
        """Return the whole frame."""
        return encode_frame(frame.body.value.packet_id, frame.body.value.content, "little")
