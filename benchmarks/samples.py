"""Typical packets of all 60 kinds, from a seed."""

from __future__ import annotations

from random import Random
from typing import Any, get_type_hints

from servolink.protocol.codec import PACKETS
from servolink.protocol.packet import Packet, Value, bare, counted, group, value

RECORDS = 16
"""Servos, steps, buttons, ... in a sample that has any."""


def samples() -> list[Packet]:
    """Return one packet of each kind, in the order of the document."""
    return [_sample(PACKETS[packet_id], Random(packet_id)) for packet_id in sorted(PACKETS)]


def _sample(declared: type[Packet], random: Random) -> Packet:
    hints = get_type_hints(declared, include_extras=True)
    return declared(*[_field(name, hints[name], random) for name in declared.__struct_fields__])


def _field(name: str, hint: Any, random: Random) -> Any:
    if bare(hint) is bytes:
        return random.randbytes(64)
    if counted(hint) is None:
        return _single(value(name, hint), random)
    record, values = group(hint)
    rows = [[_single(one, random) for one in values] for _ in range(RECORDS)]
    return tuple(row[0] if record is None else record(*row) for row in rows)


def _single(declared: Value, random: Random) -> Any:
    if declared.is_caption:
        return f"caption {random.randrange(1000)}"
    return random.randint(max(declared.low, -999), min(declared.high, 999))
