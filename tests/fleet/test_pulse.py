"""The barrier of a stop: what was sent before the stop is refused, whatever comes back first."""

from __future__ import annotations

import itertools

import pytest

from servolink.fleet import pulse as module
from servolink.fleet.pulse import Pulse, StopBarrier


async def _send(word: str, qos: int) -> None:
    raise AssertionError


def test_a_command_with_the_word_of_the_stop_is_accepted_before_the_word_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "time_with_sleep", itertools.count().__next__)
    pulse = Pulse(_send)
    barrier = StopBarrier(pulse)
    before = pulse.new_word()
    barrier.put_up()
    assert [barrier.rejects(word) for word in (None, before, "of another")] == [True, True, True]
    assert [barrier.rejects(word) for word in (barrier.word, pulse.new_word())] == [False, False]
    barrier.heard(barrier.word.encode())
    assert [barrier.rejects(word) for word in (None, before)] == [False, True]
