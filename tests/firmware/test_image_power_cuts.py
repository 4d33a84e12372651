"""Power cuts of the shipped image in the emulator, down to the flash: what is stored is old or new, never broken."""

from __future__ import annotations

import random
import struct

from servolink.firmware.compiling import IMAGE
from tests.firmware.conversations import frame
from tests.firmware.emulated import EmulatedPico, emulated, needs_emulator
from tests.firmware.test_core import add_action, add_macro, answers
from tests.sampling import every

pytestmark = needs_emulator

_State = dict[str, bytes]
_LISTS = {30010: 30020, 30050: 30060, 40010: 40020}
"""Requests for lists, and for one of its records."""


def _answer(pico: EmulatedPico, request: bytes) -> bytes:
    """Return the content of the response, however long flash takes."""
    sent = pico.ask(request, 0.002)
    for _ in range(600):
        if found := answers(sent):
            ((_, content),) = found
            return content
        sent += pico.run(0.02)
    raise AssertionError(f"no response to {request[:12].hex()}")


def _stored(pico: EmulatedPico) -> _State:
    found = {str(packet_id): _answer(pico, frame(packet_id)) for packet_id in (30100, 30130, 40060)}
    for listing, query in _LISTS.items():
        rows = _answer(pico, frame(listing))[2:]
        for at in range(0, len(rows), 36):
            found[f"{query} {rows[at : at + 4].hex()}"] = _answer(pico, frame(query, rows[at : at + 4]))
    return found


def _change(draw: random.Random) -> bytes:
    number = draw.randrange(1, 4)
    match draw.randrange(6):
        case 0:
            return frame(30120, struct.pack("<i", draw.randrange(1000)))
        case 1:
            return frame(30040, struct.pack("<i", number))
        case 2:
            return add_macro(number, *[(number, 0, 100, draw.randrange(100))] * draw.randrange(20))
        case 3:
            return frame(30110, struct.pack("<HBh32s", 1, number, draw.randrange(-20, 20), b"servo"))
        case _:  # long ones fill the banks of flash, so that they are exchanged
            steps = [(servo % 16 + 1, draw.randrange(90), 1) for servo in range(draw.choice([40, 400, 3500]))]
            return add_action(number, *steps)


@every(5)
def test_a_power_cut_at_the_flash_leaves_the_old_state_or_the_new_one(step: int) -> None:
    draw = random.Random(11)
    outcomes = set[str]()
    with emulated(IMAGE, "usb") as pico, emulated(IMAGE, "usb") as twin:  # the twin has the same changes and no cut
        pico.run(1)
        before = _stored(twin)
        for _ in range(50 // step):
            for confirmed in [_change(draw) for _ in range(draw.randrange(4))]:
                assert _answer(pico, confirmed) == _answer(twin, confirmed)
                before = _stored(twin)
            change = _change(draw)
            result = _answer(twin, change)
            after = _stored(twin)
            if draw.randrange(3):  # in the middle of what flash programs for the change, if anything
                sent = pico.ask(change, 0.001)
                for _ in range(300):
                    if not pico.is_busy or pico.is_erasing:
                        sent += pico.run(0.0002)
                sent += pico.run(len(change) * 1.6e-6 * draw.random())
            else:
                sent = pico.ask(change, draw.choice([0.005, 0.05, 0.3]) * draw.random())
            was_busy = pico.is_busy
            pico.command(cut=draw.randrange(2**32), run=0.5)
            found = _stored(pico)
            assert found == after or (found == before and not sent), "broken, or a confirmed change is lost"
            outcomes |= {"busy" if was_busy else "idle", "new" if found == after else "old"}
            if found != after:
                other = frame(40030, struct.pack("<i32sH", 1, draw.randbytes(8), 0))  # not over what was cut off
                assert _answer(pico, other) == _answer(twin, other)
                assert _answer(pico, change) == result
                after = _stored(twin)
                assert _stored(pico) == after
            before = after
    assert outcomes >= {"busy", "new", "old"}
