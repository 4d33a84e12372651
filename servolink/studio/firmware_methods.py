"""Method by which a page fetches the firmware of a Pico, for the browser to save."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control import Role, Touches
from servolink.firmware import IMAGE, SERVOS, from_uf2, read_settings, to_uf2, with_settings
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.support import computed


class FirmwareAsk(Struct, forbid_unknown_fields=True):
    """Number of servos of the board."""

    servos: Annotated[int, Meta(ge=1, le=SERVOS)] = SERVOS


class Firmware(Struct, frozen=True):
    """Image for the drive of a Pico in boot mode."""

    name: str
    data: bytes
    """UF2 blocks, in base64."""


@METHODS.add("studio.firmware", Role.EDIT, touches=Touches.HOST)
@computed
def firmware(caller: PageCaller, params: FirmwareAsk) -> Firmware:
    """Return the firmware as `servolink firmware install` writes it onto a Pico."""
    binary = from_uf2(IMAGE.read_bytes())
    settings = replace(read_settings(binary), servos=params.servos)
    return Firmware(IMAGE.name, to_uf2(with_settings(binary, settings)))
