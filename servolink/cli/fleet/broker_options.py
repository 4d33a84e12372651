"""Options of `servolink fleet` for the address of the broker and the choice of boards."""

from __future__ import annotations

import argparse
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from servolink import fleet
from servolink.cli.arguments import file_path, not_empty
from servolink.cli.command import group, option
from servolink.errors import OpenError

if TYPE_CHECKING:
    from servolink.fleet import BrokerAccess, Fleet

BROKER_VARIABLE = "SERVOLINK_BROKER"
_BROKER = "mqtt://localhost"
NOBODY = "no board has joined this broker under this prefix: run `servolink fleet join` on the machine of a board"


ACCESS = (
    group(
        "the broker",
        option("--prefix", "TEXT", "of the topics (servolink)", not_empty),
        option("--user", "NAME", "in place of the one in URL", not_empty),
        option(
            "--password-file",
            "FILE",
            "with the password in its first line (SERVOLINK_MQTT_PASSWORD; the keyring of the system)",
            file_path,
        ),
        option("--ca", "FILE", "certificates that the broker's is checked against", file_path),
        option("--certificate", "FILE", "of this program, if the broker wants one", file_path),
        option("--key", "FILE", "that belongs to it", file_path),
    ),
)


BROKER = (
    option(
        "--broker",
        "URL",
        f"such as mqtt://teacher.local or mqtts://USER@HOST:8883 ({BROKER_VARIABLE}; {_BROKER})",
        not_empty,
    ),
    *ACCESS,
)


def access_of(args: argparse.Namespace, url: str) -> BrokerAccess:
    """Return the credentials for the broker at `url`. Raise InvalidAddress or ServolinkError with the correction."""
    from servolink.fleet import BrokerAccess

    return BrokerAccess.of(
        url, user=args.user, password_file=args.password_file, ca=args.ca, certificate=args.certificate, key=args.key
    )


GROUPS_FILE = option("--groups", "FILE", "where groups are named (fleet.toml in the user's config folder)", file_path)

GROUPS = (
    option("--on", "BOARDS", "names of boards and groups, with commas between them (all)", not_empty, action="append"),
    GROUPS_FILE,
)


def fleet_of(args: argparse.Namespace, *, servos: bool = False, may_move: bool = True) -> Fleet:
    """Return the fleet of `args`. Raise InvalidAddress or ServolinkError with the correction."""
    from servolink.fleet import PREFIX

    url = args.broker or os.environ.get(BROKER_VARIABLE) or _BROKER
    groups = getattr(args, "groups", None)
    access, prefix = access_of(args, url), args.prefix or PREFIX
    return fleet.connect(access, prefix=prefix, groups=groups, servos=servos, may_move=may_move)


@asynccontextmanager
async def boards_of(args: argparse.Namespace) -> AsyncIterator[Fleet]:
    """Yield the fleet of `args`, connected. Raise OpenError if no board is there."""
    async with fleet_of(args) as fleet:
        await fleet.list()
        if not fleet.controller.roster.online:
            raise OpenError(NOBODY)
        yield fleet
