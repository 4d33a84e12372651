"""Commands of a fleet: many boards, through an MQTT broker."""

from __future__ import annotations

from servolink.cli.command import TOGETHER, Command

FLEET = Command(
    "fleet",
    TOGETHER,
    help="see and command many boards, through an MQTT broker",
    examples=("fleet list", "fleet run Wave --on all", "fleet stop"),
    takes_board=False,
)
