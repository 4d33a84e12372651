"""Joining a hub: what a program does that finds one which does not answer."""

from __future__ import annotations

import asyncio
import socket
import sys
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.control import share_address
from servolink.errors import OpenError
from servolink.support import socket_folder, socket_path


@pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets")
def test_a_hub_that_says_nothing_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(share_address, "_WELCOME_LIMIT", 0.1)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))

    async def main() -> None:
        (tmp_path / "servolink").mkdir(mode=0o700)
        with socket_folder() as short, socket.socket(socket.AF_UNIX) as listening:
            listening.bind(socket_path(short, "rex"))
            listening.listen(0)
            for _ in range(3):  # the last one does not even get into the queue
                with pytest.raises(OpenError, match=r"the hub did not answer within 0\.1 s"):
                    await connect("share://rex")

    asyncio.run(main())
