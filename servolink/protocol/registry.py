"""All packets, by id and by name."""

from __future__ import annotations

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.packet import Packet, Request, Response

PACKETS: dict[int, type[Packet]] = {
    declared.packet_id: declared
    for chapter in (settings, servos, editing, joystick)
    for declared in vars(chapter).values()
    if isinstance(declared, type) and issubclass(declared, Packet) and hasattr(declared, "packet_id")
}
"""Every packet class of the document, by packet id."""

PACKETS_BY_NAME: dict[str, type[Packet]] = {declared.__name__: declared for declared in PACKETS.values()}
"""Every packet class of the document, by its name there."""


def response_class(request: Request[Response]) -> type[Packet]:
    """Return the class of the answer to `request`: the packet whose id is one higher."""
    return PACKETS[request.packet_id + 1]
