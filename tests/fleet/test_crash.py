"""A bridge that is killed in the middle of a command, and started again, moves nothing twice."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from servolink.hub import serve_board
from tests.fleet.bridged import far_away, run
from tests.fleet.mosquitto import Broker, needs_broker
from tests.processes import start_async

pytestmark = [*needs_broker, pytest.mark.slow, pytest.mark.usefixtures("user")]

PROGRAM = str(Path(__file__).with_name("killed_bridge.py"))


@pytest.mark.parametrize(("point", "angle"), [("noted", 0), ("before", 0), ("after", 60)])
def test_a_killed_bridge_repeats_nothing(broker: Broker, user: Path, point: str, angle: int) -> None:
    policy = user / "fleet.toml"
    policy.write_text('[default]\nallow = "move"\n', encoding="utf-8")

    async def main() -> None:
        async with serve_board("virtual://?servos=1", name="rex") as (hub, _), far_away(broker) as far:
            await hub.board.move({1: 0}, duration=0.01, wait=True)
            join = [sys.executable, PROGRAM, point, broker.url, "rex", "--policy", str(policy), "--hz", "0"]
            first = await start_async(*join)
            await far.state(lambda state: state["servos"] == 1)
            command = await far.send("move", params={"targets": {"1": 60}, "duration": 0.01, "wait": True}, expiry=60)
            assert await first.wait() == -signal.SIGKILL
            assert [servo.angle for servo in await hub.board.servos()] == [angle]
            await hub.board.move({1: 0}, duration=0.01, wait=True)
            join[2] = "never"
            second = await start_async(*join)
            answer = await far.result(command)
            assert answer["error"]["data"]["kind"] == "OutcomeUnknown"
            await far.call("battery")  # whatever was delivered again came before this
            assert [servo.angle for servo in await hub.board.servos()] == [0]
            assert len(await far.results(command)) == 1
            second.send_signal(signal.SIGINT)
            assert await second.wait() == 0
            assert second.stderr is not None
            assert await second.stderr.read() == b"ended: the boards were left unchanged\n"

    run(main())
