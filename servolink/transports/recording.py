"""Writes down what passes through a transport, a JSON object a line, for `replay://` and for people."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import TextIO

from servolink.errors import OpenError
from servolink.printable import printable
from servolink.transports.base import Receiver, Transport
from servolink.transports.wrapper import WrappedTransport


class RecordingTransport(WrappedTransport):
    """Records both directions with times.

    A line is `{"t": seconds since opening, "sent": hex}`, or `"received": hex`, or `"lost": text` as the last one.
    Each is on its way to the disk before the next, so that a crash loses one line at most.
    """

    def __init__(self, inner: Transport, path: str | Path) -> None:
        """Record `inner` to a new file at `path`."""
        super().__init__(inner)
        self._path = Path(path)
        self._file: TextIO | None = None
        self._start = 0.0

    async def open(self, receiver: Receiver) -> None:
        """Make the file, then open the wrapped transport; a file that is there already is an OpenError."""
        self._check_unused()
        try:
            self._file = self._path.open("x", encoding="ascii", buffering=1)
        except FileExistsError as error:
            raise OpenError(f"{self._shown()} exists already; remove it or record to another file") from error
        except (OSError, ValueError) as error:
            raise OpenError(
                f"cannot record to {self._shown()}: {printable(str(error))}; choose another file"
            ) from error
        self._start = asyncio.get_running_loop().time()
        try:
            await super().open(receiver)
        except BaseException:
            self._close_file()
            self._path.unlink(missing_ok=True)
            raise

    async def send(self, data: bytes) -> None:
        """Record and send all of `data`."""
        self._check_open()
        if data:
            self._write("sent", data.hex())
        await super().send(data)

    def data(self, chunk: bytes, /) -> None:
        """Record `chunk` and pass it on."""
        self._write("received", chunk.hex())
        super().data(chunk)

    def _end(self, error: Exception | None) -> None:
        if error is not None:
            self._write("lost", str(error))
        self._close_file()
        super()._end(error)

    def _write(self, what: str, text: str) -> None:
        if self._file is None:
            return
        seconds = round(asyncio.get_running_loop().time() - self._start, 6)
        try:
            self._file.write(json.dumps({"t": seconds, what: text}) + "\n")
        except OSError as error:  # going on with a hole in the recording would mislead whoever reads it
            self._close_file()
            self._break(f"{self._shown()} cannot be written: {printable(str(error))}")

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:
                return  # the disk is full, which the write before has told

    def _shown(self) -> str:
        return printable(str(self._path))
