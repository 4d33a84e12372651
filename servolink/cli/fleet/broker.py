"""Options of `servolink fleet` that say where the broker is, and which boards are meant."""

from __future__ import annotations

import argparse
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from servolink.cli.arguments import file_path, not_empty
from servolink.cli.command import group, option
from servolink.errors import OpenError

if TYPE_CHECKING:
    from servolink.fleet.access import BrokerAccess
    from servolink.fleet.client import Fleet

BROKER_VARIABLE = "SERVOLINK_BROKER"
_BROKER = "mqtt://localhost"
NOBODY = "no board has joined this broker under this prefix: run `servolink fleet join` on the machine of a board"


ACCESS = (
    group(
        "the broker",
        option("--prefix", type=not_empty, metavar="TEXT", help="of the topics (servolink)"),
        option("--user", type=not_empty, metavar="NAME", help="in place of the one in URL"),
        option(
            "--password-file",
            type=file_path,
            metavar="FILE",
            help="with the password in its first line (SERVOLINK_MQTT_PASSWORD; the keyring of the system)",
        ),
        option("--ca", type=file_path, metavar="FILE", help="certificates that the broker's is checked against"),
        option("--certificate", type=file_path, metavar="FILE", help="of this program, if the broker wants one"),
        option("--key", type=file_path, metavar="FILE", help="that belongs to it"),
    ),
)


BROKER = (
    option(
        "--broker",
        type=not_empty,
        metavar="URL",
        help=f"such as mqtt://teacher.local or mqtts://USER@HOST:8883 ({BROKER_VARIABLE}; {_BROKER})",
    ),
    *ACCESS,
)


def access_of(args: argparse.Namespace, url: str) -> BrokerAccess:
    """Return how to get into the broker at `url`. Raise InvalidAddress or ServolinkError, which say what to correct."""
    from servolink.fleet.access import broker_access

    return broker_access(
        url, user=args.user, password_file=args.password_file, ca=args.ca, certificate=args.certificate, key=args.key
    )


GROUPS = (
    option(
        "--on",
        action="append",
        type=not_empty,
        metavar="BOARDS",
        help="names of boards and groups, with commas between them (all)",
    ),
    option(
        "--groups",
        type=file_path,
        metavar="FILE",
        help="where groups are named (fleet.toml in the user's config folder)",
    ),
)


def fleet_of(args: argparse.Namespace, *, servos: bool = False) -> Fleet:
    """Return the fleet of `args`. Raise InvalidAddress or ServolinkError, which say what to correct."""
    from servolink import fleet
    from servolink.fleet.topics import PREFIX

    url = args.broker or os.environ.get(BROKER_VARIABLE) or _BROKER
    groups = getattr(args, "groups", None)
    return fleet.connect(access_of(args, url), prefix=args.prefix or PREFIX, groups=groups, servos=servos)


@asynccontextmanager
async def boards_of(args: argparse.Namespace) -> AsyncIterator[Fleet]:
    """Yield the fleet of `args`, connected. Raise OpenError if no board is there."""
    async with fleet_of(args) as fleet:
        await fleet.list()
        if not fleet.controller.roster.online:
            raise OpenError(NOBODY)
        yield fleet
