"""Typical packets of all 60 kinds, from a seed, of any size that they can have."""

from __future__ import annotations

from functools import cache
from random import Random
from typing import Any, get_type_hints

from servolink.protocol.codec import PACKETS
from servolink.protocol.frame import OVERHEAD
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet, Value, bare, counted, group, value

RECORDS = 16
"""Servos, steps, buttons, ... in a sample that has any."""


def samples() -> list[Packet]:
    """Return one packet of each kind, in the order of the document."""
    return [_sample(PACKETS[packet_id], Random(packet_id)) for packet_id in sorted(PACKETS)]


@cache
def near(size: int) -> list[Packet]:
    """Return one packet of each kind whose frame can have about `size` bytes, 14 or 186: four or eight more or less.

    That are 44 kinds for 14 bytes and 15 for 186.
    """
    found = []
    for packet_id, declared in sorted(PACKETS.items()):
        rule = layout(declared, "little").rule
        fit = round((size - OVERHEAD - rule.base) / rule.unit) if rule.unit else 0
        count = min(max(fit, 0), rule.limit)
        if abs(OVERHEAD + rule.base + count * rule.unit - size) <= (4 if size < 100 else 8):
            found.append(_sample(declared, Random(packet_id), count))
    return found


def _sample(declared: type[Packet], random: Random, count: int | None = None) -> Packet:
    hints = get_type_hints(declared, include_extras=True)
    return declared(*[_field(name, hints[name], random, count) for name in declared.__struct_fields__])


def _field(name: str, hint: Any, random: Random, count: int | None) -> Any:
    """Return a value; `count` is the length of a group, or of data in bytes."""
    if bare(hint) is bytes:
        return random.randbytes(64 if count is None else count)
    if counted(hint) is None:
        return _single(value(name, hint), random)
    record, values = group(hint)
    rows = [[_single(one, random) for one in values] for _ in range(RECORDS if count is None else count)]
    return tuple(row[0] if record is None else record(*row) for row in rows)


def _single(declared: Value, random: Random) -> Any:
    if declared.is_caption:
        return f"caption {random.randrange(1000)}"
    return random.randint(max(declared.low, -999), min(declared.high, 999))
