"""Time that the firmware takes in the worst case, for any content: instructions of the shipped image, in the emulator.

The core's clock and the line are those of a real Pico: 48 MHz, USB at full speed.
"""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator

import pytest

from servolink.firmware.compiling import IMAGE
from tests.firmware.conversations import frame
from tests.firmware.emulated import EmulatedPico, emulated, needs_emulator
from tests.firmware.test_core import READY, RELEASE, STOP, add_action, add_macro, answers, move, run_macro

pytestmark = needs_emulator

_CORE_HZ = 48_000_000
_PERIOD = 0.02
_WATCHDOG = 0.2
"""Seconds after which the watchdog resets the chip."""
_MOST = int(_WATCHDOG / 5 * _CORE_HZ / 2)
"""Most instructions of one turn of the firmware's loop; each is reckoned as two clocks."""
_ZEROS = [(servo % 16 + 1, 0, 1) for servo in range(13_000)]
"""Steps of an action that fills the memory."""


@pytest.fixture
def pico() -> Iterator[EmulatedPico]:
    with emulated(IMAGE, "usb", _CORE_HZ) as started:
        started.ask(READY)
        yield started
        assert started.resets == 0


def _ask(pico: EmulatedPico, *requests: bytes) -> list[tuple[int, bytes]]:
    """Return the answers to requests that are sent together, after a turn of the loop of bounded length."""
    sent, found = pico.ask(b"".join(requests), 0.01), list[tuple[int, bytes]]()
    for _ in range(250):
        assert pico.longest < _MOST, (requests[0][:12].hex(), pico.longest)
        if len(found := answers(sent)) >= len(requests):
            break
        sent += pico.run(0.02)
    return found


def _same_hash(count: int) -> list[int]:
    """Return ids that many hash functions put into one place: they differ in the high bits only, or by a step."""
    return [(number << 16) - 2**31 if number % 2 else number << 11 for number in range(1, count + 1)]


def test_hundreds_of_actions_with_like_ids_are_found_in_time(pico: EmulatedPico) -> None:
    ids = _same_hash(900)
    for at in range(0, len(ids), 50):
        assert all(answer == (30031, b"\1") for answer in _ask(pico, *(add_action(each) for each in ids[at : at + 50])))
    commands = [(each, 0, 100, 1) for each in random.Random(1).sample(ids, 500)]
    assert _ask(pico, add_macro(1, *commands)) == [(30071, b"\1")]
    assert _ask(pico, run_macro(1), frame(30040, struct.pack("<i", ids[0])), run_macro(1), frame(30010))
    pico.run(0.2)
    assert pico.longest < _MOST


@pytest.mark.parametrize("kind", ["actions", "macros"])
@pytest.mark.parametrize("commands", [4400, 5000])
def test_the_longest_macros_are_checked_and_run_in_time(pico: EmulatedPico, commands: int, kind: str) -> None:
    ids = _same_hash((65536 - 12 * commands - 64 - 40) // 64)
    add, delete, code = (add_action, 30040, 0) if kind == "actions" else (add_macro, 30080, 2)
    for at in range(0, len(ids), 50):
        _ask(pico, *(add(each) for each in ids[at : at + 50]))
    draw = random.Random(2)
    names = [(draw.choice(ids), code, 100, 1) for _ in range(commands)]
    assert _ask(pico, add_macro(9, *names)) == [(30071, b"\1")]
    assert _ask(pico, run_macro(9)) == [(30091, b"\1")]
    change = frame(delete, struct.pack("<i", names[-1][0]))
    assert _ask(pico, change, run_macro(9), run_macro(9)) == [(delete + 1, b"\1"), (30091, b"\0"), (30091, b"\0")]
    pico.run(0.3)
    assert pico.longest < _MOST


def test_an_action_that_fills_the_memory_is_stored_told_and_executed_in_time(pico: EmulatedPico) -> None:
    assert _ask(pico, add_action(1, *_ZEROS)) == [(30031, b"\1")]
    assert len(_ask(pico, frame(30020, struct.pack("<i", 1)))[0][1]) == 38 + 5 * len(_ZEROS)
    assert _ask(pico, frame(20060, struct.pack("<i", 1)) + frame(20010)) == [(20011, bytes([16, *range(1, 17)]))]
    assert _ask(pico, add_macro(1, *[(1, 0, 100, 30_000)] * 5)) == [(30071, b"\1")]
    assert _ask(pico, run_macro(1)) == [(30091, b"\1")]
    assert _ask(pico, add_action(1, *_ZEROS)) == [(30031, b"\0")], "the running macro needs what is there"
    pico.run(0.3)
    assert pico.longest < _MOST


def test_packed_requests_and_lists_take_a_turn_each(pico: EmulatedPico) -> None:
    for at in range(0, 500, 50):
        _ask(pico, *(add_action(at + each + 1) for each in range(50)))
    assert pico.ask(frame(30010) * 7, 1), "those for which there is no room are lost"
    assert pico.longest < _MOST
    assert _ask(pico, *(frame(30040, struct.pack("<i", each + 1)) for each in range(20)))
    _ask(pico, frame(10020), frame(30010))


def _beginnings(packet_id: int, length: int) -> bytes:
    """Return beginnings of frames, one directly behind the other."""
    return frame(packet_id, bytes(length))[:8] * 8190


_RANDOM = random.Random(3).randbytes(65_000)
_GARBAGE = {
    "beginnings of long frames": _beginnings(10050, 60_000),
    "beginnings of frames that end": _beginnings(10050, 90),
    "beginnings of movements": _beginnings(20050, 96),
    "beginnings of another kind": _beginnings(12345, 3),
    "noise": _RANDOM,
    "requests": frame(30010) * 7200,
    "deletions": frame(30040, b"\1\0\0\0") * 5000,
}


@pytest.mark.parametrize(
    ("kind", "request_"),
    [*((kind, RELEASE) for kind in _GARBAGE), *((kind, STOP) for kind in list(_GARBAGE)[:2])],
)
def test_a_stop_behind_a_frame_of_garbage_acts_in_time(pico: EmulatedPico, kind: str, request_: bytes) -> None:
    is_held = request_ == STOP
    pico.ask(move((1, 90, 500)), 0.7)
    damaged = bytearray(frame(10050, _GARBAGE[kind][:65_520]))
    damaged[-1] ^= 1
    pico.command(usb=(damaged + request_).hex())
    sent = pico.now
    pico.run(0.15)
    assert pico.longest < _MOST
    widths = pico.widths_since(0, sent + 0.02 + (_PERIOD if is_held else 0))
    assert len(set(widths)) == is_held, "no pulse of a released servo, the same one of a stopped servo"


@pytest.mark.parametrize("line", ["uart", "usb"])
def test_a_stop_within_half_a_frame_acts_in_time(line: str) -> None:
    with emulated(IMAGE, line) as pico:
        pico.ask(READY)
        pico.ask(move((1, 90, 500)), 1.5)
        pico.ask(frame(10050, bytes(60_000))[:20] + RELEASE, 0)
        sent = pico.now
        for _ in range(20):
            pico.ask(frame(20010), 0.02)  # others go on asking, so that the line is never quiet
        assert pico.widths_since(0, sent + 0.02) == []


def _many_paths_to_a_long_macro(pico: EmulatedPico) -> bytes:
    """Store macros that each name too many levels, behind a long one; return requests to run them."""
    for number in range(1, 41):
        _ask(pico, add_action(number))
    _ask(pico, *(add_macro(200 + each, (201 + each, 2, 100, 1)) for each in range(15)), add_macro(215, (1, 0, 100, 1)))
    draw = random.Random(4)
    _ask(pico, add_macro(99, *[(draw.randrange(1, 41), 0, 100, 1) for _ in range(4000)], (200, 2, 100, 1)))
    _ask(pico, *(add_macro(300 + each, (99, 2, 100, 1)) for each in range(100)))
    return b"".join(run_macro(300 + each) for each in range(100))


def _checks_after_each_change(pico: EmulatedPico) -> bytes:
    """Store a long macro; return requests that change an action of it and run it."""
    for number in range(1, 41):
        _ask(pico, add_action(number))
    draw = random.Random(5)
    _ask(pico, add_macro(9, *[(draw.randrange(1, 41), 0, 100, 1) for _ in range(4700)]))
    return (add_action(20) + run_macro(9)) * 60


def _a_long_action_beside_a_macro_of_it(pico: EmulatedPico) -> bytes:
    """Store an action that fills the memory, and let a macro run it again and again; return requests to run it too."""
    _ask(pico, add_action(1, *[(servo, 0, 0) for servo, _, _ in _ZEROS[:12_500]]))
    assert _ask(pico, add_macro(1, *[(1, 0, 100, 30_000)] * 5), run_macro(1)) == [(30071, b"\1"), (30091, b"\1")]
    return frame(20060, struct.pack("<i", 1)) * 100


@pytest.mark.parametrize("line", ["uart", "usb"])
@pytest.mark.parametrize(
    "prepare", [_a_long_action_beside_a_macro_of_it, _many_paths_to_a_long_macro, _checks_after_each_change]
)
def test_a_release_behind_requests_that_take_long_acts_in_time(
    line: str, prepare: Callable[[EmulatedPico], bytes]
) -> None:
    with emulated(IMAGE, line, _CORE_HZ) as pico:
        requests = prepare(pico)
        pico.ask(READY + move((1, 90, 500)), 1.2)
        pico.command(**{line: (requests + RELEASE).hex()})
        sent = pico.now
        pico.run(0.1)
        assert pico.pulses[0][-1][0] > sent - 1
        assert pico.widths_since(0, sent + 0.02) == []
