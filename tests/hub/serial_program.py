"""A program without any library on the pseudo-terminal of a hub."""

from __future__ import annotations

import asyncio
import os
from typing import Self


class Port:
    """The terminal, as a program without any library opens it."""

    def __init__(self, url: str) -> None:
        self.number = os.open(url.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        os.close(self.number)

    async def send(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self.number, data) :]
            except BlockingIOError:
                await asyncio.sleep(0)

    async def until(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            try:
                data += os.read(self.number, count - len(data))
            except BlockingIOError:
                await asyncio.sleep(0.001)
        return data

    def is_silent(self) -> bool:
        try:
            return not os.read(self.number, 1)
        except BlockingIOError:
            return True
