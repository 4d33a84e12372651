"""Line between a studio and a board: passes all bytes on, and notes each frame as the document describes frames."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

_HEADER = bytes.fromhex("134c051d")


class Frame(NamedTuple):
    """Frame on the line."""

    packet_id: int
    content: bytes


class Wire:
    """TCP proxy in front of the board at a port of this machine."""

    def __init__(self, board_port: int) -> None:
        self.sent: list[Frame] = []
        """Frames to the board."""
        self._board_port = board_port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._host: socket.socket | None = None
        self._ends: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def count(self, packet_id: int) -> int:
        """Return how many frames of an id were sent to the board."""
        return len(self.sent_of(packet_id))

    def sent_of(self, packet_id: int) -> list[bytes]:
        """Return the contents of the frames of an id that were sent to the board."""
        return [frame.content for frame in list(self.sent) if frame.packet_id == packet_id]

    def push(self, packet_id: int, content: bytes) -> None:
        """Send a frame to the studio, in place of the board."""
        head = _HEADER + packet_id.to_bytes(2, "little") + len(content).to_bytes(2, "little") + content
        assert self._host is not None
        self._host.sendall(head + bytes([sum(head) & 0xFF]))

    def close(self) -> None:
        """End all connections."""
        for end in (self._listener, *self._ends):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                host, _ = self._listener.accept()
                board = socket.create_connection(("127.0.0.1", self._board_port))
                self._ends += [host, board]
                self._host = host
                threading.Thread(target=self._carry, args=(host, board, self.sent), daemon=True).start()
                threading.Thread(target=self._carry, args=(board, host, None), daemon=True).start()

    @staticmethod
    def _carry(source: socket.socket, target: socket.socket, found: list[Frame] | None) -> None:
        rest = b""
        with suppress(OSError):
            while data := source.recv(65536):
                target.sendall(data)
                if found is not None:  # a bad line gives more than frames to the host
                    rest = _take(rest + data, found)
        for end in (source, target):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


def _take(data: bytes, found: list[Frame]) -> bytes:
    """Add the frames in `data`, and return the bytes after the last one. The line must hold nothing else."""
    while len(data) >= 8:
        assert data.startswith(_HEADER), data[:16].hex()
        size = int.from_bytes(data[6:8], "little")
        if len(data) < size + 9:
            break
        assert sum(data[: size + 8]) & 0xFF == data[size + 8]
        found.append(Frame(int.from_bytes(data[4:6], "little"), data[8 : size + 8]))
        data = data[size + 9 :]
    return data


@contextmanager
def wire_to(url: str) -> Iterator[Wire]:
    """Yield the line to the board at `url`, such as `tcp://127.0.0.1:7811`."""
    wire = Wire(int(url.rpartition(":")[2]))
    try:
        yield wire
    finally:
        wire.close()
