"""Tests of `servolink.fleet.clocks`, over networks and clocks that are made up."""

from __future__ import annotations

import math
from random import Random

import pytest

from servolink.fleet.clocks import BoardClocks
from tests.tables import over

BOARDS = [f"board{number}" for number in range(200)]


class Machine:
    """Clock that is off and drifts."""

    def __init__(self, random: Random, name: str) -> None:
        self.name, self.off, self.pace = name, random.uniform(-5, 5), 1 + random.uniform(-5e-4, 5e-4)

    def read(self, moment: float) -> float:
        return moment * self.pace + self.off

    def moment_of(self, reading: float) -> float:
        return (reading - self.off) / self.pace


def echo(clocks: BoardClocks, random: Random, machines: dict[str, Machine], sent: float) -> float:
    """Send an echo to boards: it arrives after 1 to 8 ms, and the answers come one after the other."""
    answered = sent
    arrivals = {machine: sent + random.uniform(0.001, 0.008) for machine in machines.values()}
    for board, machine in machines.items():
        answered = max(answered + 0.0002, arrivals[machine] + random.uniform(0.001, 0.008))
        clocks.heard(board, sent, machine.read(arrivals[machine]), answered)
    return answered


@over("per_host", [1, 10, 200])
@over("seed", range(10))
def test_200_boards_begin_within_20_ms_whatever_their_clocks_say(seed: int, per_host: int) -> None:
    random = Random(seed)
    hosts = [Machine(random, f"laptop{number}") for number in range(200 // per_host)]
    machines = {board: hosts[number // per_host] for number, board in enumerate(BOARDS)}
    clocks, now = BoardClocks(lambda board: machines[board].name), 100.0
    for _ in range(3):
        for at in range(0, 200, 16):
            now = echo(clocks, random, {board: machines[board] for board in BOARDS[at : at + 16]}, now)
    moments = clocks.moments(now + 0.3)
    begun = [machines[board].moment_of(moments[board]) - now - 0.3 for board in BOARDS]
    assert max(begun) - min(begun) < 0.02
    assert max(map(abs, begun)) < 0.01


def test_two_machines_of_one_name_do_not_spoil_each_other() -> None:
    clocks = BoardClocks(lambda board: "raspberrypi")
    clocks.heard("rex", 10.0, 500.005, 10.010)
    clocks.heard("fido", 10.0, 2.005, 10.010)
    assert clocks.moments(11.0) == {"rex": pytest.approx(501.0), "fido": pytest.approx(-7.0 + 10)}


def test_the_quickest_ways_to_and_from_a_machine_count() -> None:
    clocks = BoardClocks(lambda board: "laptop")
    clocks.heard("rex", 10.0, 13.001, 10.5)  # quick there, and slow back
    clocks.heard("fido", 11.0, 14.499, 11.5)  # slow there, and quick back
    assert clocks.moments(12.0) == {"rex": pytest.approx(15.0), "fido": pytest.approx(15.0)}


def test_a_board_without_an_echo_has_no_moment() -> None:
    clocks = BoardClocks(lambda board: board)
    assert clocks.moments(1.0) == {}
    assert clocks.delays["rex"] == math.inf
