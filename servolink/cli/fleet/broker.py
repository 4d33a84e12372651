"""`servolink fleet`: its verbs, and the options that say where the broker is."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

from servolink.cli.arguments import file_path, not_empty
from servolink.cli.commands import TOGETHER, Command
from servolink.cli.parser import Parser

if TYPE_CHECKING:
    from servolink.fleet.access import BrokerAccess
    from servolink.fleet.client import Fleet

BROKER_VARIABLE = "SERVOLINK_BROKER"
_BROKER = "mqtt://localhost"


def _command(place: str, text: str, *examples: str) -> Command:
    return Command(TOGETHER, place, text, tuple(f"fleet {one}" for one in examples), takes_board=False)


COMMANDS = {
    "join": _command(
        "fleet.join:configure",
        "let the boards of this machine take part in a fleet",
        "join mqtt://teacher.local",
        "join mqtt://teacher.local virtual:// --name rex",
    ),
    "list": _command("fleet.boards:configure_list", "list the boards, with their batteries and problems", "list"),
    "watch": _command("fleet.watch:configure", "show all boards live, in one table", "watch --seconds 2"),
    "run": _command(
        "fleet.run:configure_run",
        "start an action or a macro on many boards at the same moment",
        "run Wave",
        "run Wave --on rex,fido --anyway",
    ),
    "stop": _command("fleet.run:configure_stop", "stop all servos of all boards", "stop"),
    "apply": _command(
        "fleet.apply:configure_apply",
        "make many boards hold what a project file holds, after a backup of each",
        "apply robot.servolink.json --yes",
        "apply robot.servolink.json --on rex --parallel 1 --yes",
    ),
    "export": _command(
        "fleet.apply:configure_export", "write the content of each board into a project file", "export boards --yes"
    ),
    "forget": _command(
        "fleet.boards:configure_forget", "remove boards that have left for good from the list", "forget rex --yes"
    ),
    "doctor": _command(
        "fleet.boards:configure_doctor", "find out what is wrong with the broker, the network and the boards", "doctor"
    ),
}
"""As `servolink.cli.commands.COMMANDS`."""


def configure(parser: Parser) -> None:
    """Add the verbs of `servolink fleet`."""
    parser.add_commands(COMMANDS, "verb")


# --- where the broker is ----------------------------------------------------------------------------------------------


def add_broker(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the broker is and which boards belong to the fleet."""
    parser.add_argument(
        "--broker",
        type=not_empty,
        metavar="URL",
        help=f"such as mqtt://teacher.local or mqtts://USER@HOST:8883 ({BROKER_VARIABLE}; {_BROKER})",
    )
    add_access(parser)


def add_access(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how to get into the broker."""
    group = parser.add_argument_group("the broker")
    group.add_argument("--prefix", type=not_empty, metavar="TEXT", help="of the topics (servolink)")
    group.add_argument("--user", type=not_empty, metavar="NAME", help="in place of the one in URL")
    group.add_argument(
        "--password-file",
        type=file_path,
        metavar="FILE",
        help="with the password in its first line (SERVOLINK_MQTT_PASSWORD; the keyring of the system)",
    )
    group.add_argument("--ca", type=file_path, metavar="FILE", help="certificates that the broker's is checked against")
    group.add_argument("--certificate", type=file_path, metavar="FILE", help="of this program, if the broker wants one")
    group.add_argument("--key", type=file_path, metavar="FILE", help="that belongs to it")


def access_of(args: argparse.Namespace, url: str) -> BrokerAccess:
    """Return how to get into the broker at `url`. Raise InvalidAddress or ServolinkError, which say what to correct."""
    from servolink.fleet.access import broker_access

    return broker_access(
        url, user=args.user, password_file=args.password_file, ca=args.ca, certificate=args.certificate, key=args.key
    )


def add_groups(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose boards."""
    parser.add_argument(
        "--on",
        action="append",
        type=not_empty,
        metavar="BOARDS",
        help="names of boards and groups, with commas between them (all)",
    )
    parser.add_argument(
        "--groups",
        type=file_path,
        metavar="FILE",
        help="where groups are named (fleet.toml in the user's config folder)",
    )


def fleet_of(args: argparse.Namespace, *, servos: bool = False) -> Fleet:
    """Return the fleet of `args`. Raise InvalidAddress or ServolinkError, which say what to correct."""
    from servolink import fleet
    from servolink.fleet.topics import PREFIX

    url = args.broker or os.environ.get(BROKER_VARIABLE) or _BROKER
    groups = getattr(args, "groups", None)
    return fleet.connect(access_of(args, url), prefix=args.prefix or PREFIX, groups=groups, servos=servos)
