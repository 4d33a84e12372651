"""Commands from before a sleep of the computer have expired, whatever the clock of the event loop says."""

from __future__ import annotations

import pytest
from msgspec import Raw

from servolink.control import Reply, Runnable
from servolink.errors import MotionRefused
from servolink.fleet.pulse import Pulse, PulseLink
from servolink.fleet.ready_run import ReadyRun
from servolink.fleet.topics import Prepare
from servolink.motion import StopCounter
from servolink.support import SleepCounter, time_with_sleep
from tests.support.sleeping import Computer, computer

__all__ = ["computer"]


@pytest.mark.parametrize("has_word", [True, False])
async def test_a_command_that_waited_has_expired(computer: Computer, *, has_word: bool) -> None:
    async def send(word: str, qos: int) -> None:
        raise AssertionError

    pulse = Pulse(send)
    link = PulseLink(pulse)
    link.begin()
    word = pulse.new_word()
    link.heard(word.encode())
    assert time_with_sleep() < link.latest(10, word if has_word else None)
    computer.sleep()
    assert time_with_sleep() > link.latest(10, word if has_word else None)


@pytest.mark.parametrize("seconds", [20.0, 0.0])
async def test_a_run_that_is_ready_is_not_begun_after_a_sleep(computer: Computer, seconds: float) -> None:
    class Hub:
        methods: tuple[str, ...] = ()

        async def ask(self, method: str, params: object) -> Reply:
            self.methods += (method,)
            return Reply(Raw(b'{"seconds": null, "monotonic": 1.0, "servos": []}'))

        def tell(self, method: str) -> None:
            self.methods += (method,)

    hub, stops = Hub(), StopCounter(SleepCounter())
    ready = ReadyRun(hub, stops)  # type: ignore[arg-type]
    await ready.prepare(Prepare("s1", Runnable("action", 1), 10), stops.ticket(until=time_with_sleep() + 60))
    computer.sleep(seconds)
    if seconds:
        with pytest.raises(MotionRefused, match="has expired; nothing was moved"):
            await ready.start(0.0)
    else:
        await ready.start(0.0)
    ready.forget()
    assert ("run.start" in hub.methods) is not bool(seconds)
