"""`servolink request`: any request of the protocol, with the limits, questions and backups of the other commands."""

from __future__ import annotations

import argparse
import asyncio
from typing import Any

from servolink.cli.boards.board_settings import refuse_marker
from servolink.cli.command import DEVELOPERS, Command, flag, option
from servolink.cli.command_session import UNTOUCHED, Interruption, agreed, refuse_unasked, run_with_board
from servolink.cli.developers.packets import lines_for, parse_object
from servolink.cli.motion.move import LIMITS, limits_of
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import Ending, Returned
from servolink.client import Board
from servolink.errors import EncodeError
from servolink.project import BackupStore
from servolink.protocol import (
    RECORD_TYPES,
    AddServoParameterRequest,
    ClearAllDataRequest,
    Packet,
    Request,
    Result,
    SetServoParameterRequest,
    WriteProjectIDRequest,
    packet_from_json,
    packet_to_json,
)
from servolink.protocol import Command as PacketCommand
from servolink.support import ExitCode

_DELETES: tuple[type[Packet], ...] = (ClearAllDataRequest, *(kind.delete_class for kind in RECORD_TYPES))
_OVERWRITES: tuple[type[Packet], ...] = (
    *_DELETES,
    AddServoParameterRequest,
    *(kind.add_class for kind in RECORD_TYPES),
)
"""Requests that may delete content of the board."""


@Command(
    "request",
    DEVELOPERS,
    help="send one packet of the protocol and print the response",
    examples=(
        'request \'{"QueryServoRequest": {"servo_id": 1}}\'',
        'request \'{"DeleteActionRequest": {"action_id": 2}}\' --yes',
    ),
    options=(
        option(
            "object",
            "OBJECT",
            'a packet as a JSON object: {"NAME": {FIELDS}}, or in the form of `servolink decode --json`',
        ),
        flag("--no-backup", "save no backup before something is written or deleted"),
        flag("--yes", "do not ask"),
        *LIMITS,
    ),
    needs_records=True,
)
def run(args: argparse.Namespace) -> int:
    """Send the packet and print the response. Return 1 if the board refuses."""
    packet = _packet(args)
    limits = limits_of(args)
    question = _question(packet)
    if question:
        refuse_unasked(args, f"{question}; --yes does so without asking")

    async def talk(board: Board, interruption: Interruption) -> Ending:
        if isinstance(packet, WriteProjectIDRequest):
            await refuse_marker(board, packet.project_id)
        if question and not await agreed(args, interruption, f"{question}. Send it?"):
            return ExitCode.FAILED
        if isinstance(packet, _OVERWRITES) and not args.no_backup:
            await _save(board, args)
        name = type(packet).__name__
        interruption.state = f"{name} may have been sent"
        if isinstance(packet, PacketCommand):
            await board.send(packet)
            return Returned({"sent": name}, f"{name} was sent; boards do not answer it")
        request: Any = packet
        response = await board.request(request)
        interruption.state = f"{name} was answered"
        described = packet_to_json(response)
        is_refused = isinstance(response, Result) and not response.result
        return Returned(described, lines_for(described), ExitCode.FAILED if is_refused else ExitCode.OK)

    return run_with_board(args, talk, state=UNTOUCHED, **limits)


def _packet(args: argparse.Namespace) -> Any:
    """Return the packet of the command line. Raise EncodeError if boards take no such packet."""
    try:
        value = parse_object(args.object.encode("utf-8", "surrogateescape"))
    except EncodeError as error:
        raise EncodeError(f"the packet {error}") from error
    if isinstance(value, dict) and len(value) == 1 and not value.keys() & {"packet", "id"}:
        [(name, fields)] = value.items()
        value = {"packet": name, "fields": fields}
    packet = packet_from_json(value)
    if not isinstance(packet, Request | PacketCommand):
        raise EncodeError(f"{type(packet).__name__} comes from a board; give a request")
    return packet


def _question(packet: Packet) -> str:
    """Return the question before `packet` is sent; empty for a packet that destroys nothing."""
    if isinstance(packet, ClearAllDataRequest):
        return "this deletes everything stored on the board"
    if isinstance(packet, _DELETES):
        return "this deletes a record from the board"
    if isinstance(packet, SetServoParameterRequest) and not packet.is_hold:
        return "released servos are limp, and raised limbs fall"
    return ""


async def _save(board: Board, args: argparse.Namespace) -> None:
    """Save what is on the board in a backup, and say where."""
    with shown_progress(board) as on_progress:
        project = await board.export_project(on_progress=on_progress)
    path = await asyncio.to_thread(BackupStore().keep, project, board.url, board.codec.caption_encoding)
    number = int(path.name.partition("-")[0])
    print_error(f"servolink: the content before is saved in {path}; `servolink rollback {number}` restores it")
