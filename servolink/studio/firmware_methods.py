"""Method by which a page fetches the firmware of a Pico, for the browser to save."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control.roles import Role
from servolink.firmware import compiling, image
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.tasks import computed


class FirmwareAsk(Struct, forbid_unknown_fields=True):
    """Number of servos of the board."""

    servos: Annotated[int, Meta(ge=1, le=image.SERVOS)] = image.SERVOS


class Firmware(Struct, frozen=True):
    """Image for the drive of a Pico in boot mode."""

    name: str
    data: bytes
    """UF2 blocks, in base64."""


@METHODS.add("studio.firmware", Role.EDIT)
@computed
def firmware(caller: PageCaller, params: FirmwareAsk) -> Firmware:
    """Return the firmware as `servolink firmware install` writes it onto a Pico."""
    binary = image.from_uf2(compiling.IMAGE.read_bytes())
    settings = replace(image.read_settings(binary), servos=params.servos)
    return Firmware(compiling.IMAGE.name, image.to_uf2(image.with_settings(binary, settings)))
