"""`servolink board project-id`, `mode`, `memory`, `battery`, `clear` and `dummy`: settings of a connected board."""

from __future__ import annotations

import argparse

from servolink.cli.arguments import whole_number
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import (
    KEEP_MODE,
    UNFINISHED_IMPORT,
    UNTOUCHED,
    Interruption,
    on_board,
    refuse_without_answer,
    run_with_board,
)
from servolink.cli.projects.apply import BoardImport
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.stored.change import changed_text
from servolink.cli.usage import usage_error
from servolink.client import Board
from servolink.errors import ProjectError
from servolink.project import UNFINISHED, Plan, Project
from servolink.protocol import QueryMemorySizeResponse

_DUMMY = bytes(range(16))
_FULL = 100  # percent


class ProjectId(CommandResult, frozen=True):
    """JSON of `board project-id`, as the board reports it."""

    project_id: int
    has_unfinished_import: bool


class TransmissionMode(CommandResult, frozen=True):
    """JSON of `board mode`: the mode that was set."""

    transmission_mode: int


class MemoryShown(CommandResult, frozen=True):
    """JSON of `board memory`, in bytes; -1 for a board without measurement, null without a response."""

    size_bytes: int | None
    total_size_bytes: int | None


class BatteryShown(CommandResult, frozen=True):
    """JSON of `board battery`, in percent; null for a board without measurement."""

    battery_percent: float | None


class BytesSent(CommandResult, frozen=True):
    """JSON of `board dummy`: the number of bytes sent."""

    bytes: int


@Command(
    "board project-id",
    help="show or write the project id",
    examples=("board project-id", "board project-id 7"),
    options=(option("id", "ID", "write this one; 0: none", whole_number(0, 2**31 - 1), nargs="?"), KEEP_MODE),
)
@on_board(state=UNTOUCHED)
async def run_project_id(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Print the project id, or write a new id and read the id back."""
    if args.id is not None:
        await refuse_marker(board, args.id)
        interruption.state = f"project id {args.id} may have been written"
        await board.write_project_id(args.id)
    project_id = await board.project_id()
    if args.id is not None and project_id != args.id:
        raise ProjectError(f"{board.url} accepted project id {args.id}, but reports {project_id}")
    shown = "none: an import is unfinished" if project_id in UNFINISHED else project_id or "none"
    return Returned(ProjectId(project_id, await board.has_unfinished_import()), f"project id {shown}")


async def refuse_marker(board: Board, project_id: int) -> None:
    """Raise ProjectError if `project_id` would mark an unfinished import, or would hide one."""
    if project_id in UNFINISHED:
        raise ProjectError(
            f"project id {project_id} is reserved: {UNFINISHED.start} to {UNFINISHED.stop - 1} mean that an import is "
            f"unfinished; {UNTOUCHED}"
        )
    if await board.has_unfinished_import():
        raise ProjectError(f"{UNFINISHED_IMPORT}; another project id would hide it; {UNTOUCHED}")


@Command(
    "board mode",
    help="set the transmission mode",
    examples=("board mode 1",),
    options=(
        option(
            "mode",
            "0|1",
            "1: the protocol of servolink; 0: an older one, until a command sets 1 again",
            whole_number(0, 1),
        ),
    ),
)
@on_board(state=UNTOUCHED)
async def run_mode(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Set the transmission mode."""
    interruption.state = f"transmission mode {args.mode} may have been set"
    await board.set_transmission_mode(args.mode)
    return Returned(TransmissionMode(args.mode), f"the board is in transmission mode {args.mode}")


@Command(
    "board memory",
    help="show how much memory is free",
    examples=("board memory", "board memory --json"),
    options=(KEEP_MODE,),
)
@on_board(state=UNTOUCHED)
async def run_memory(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Print the memory."""
    memory = await board.memory()
    return Returned(MemoryShown(memory.size, memory.total_size), f"memory {memory_text(board, memory)}")


def memory_text(board: Board, memory: QueryMemorySizeResponse) -> str:
    """Return free and total memory for people, with the unit as far as it was learnt."""
    if memory.size < 0:
        return "not measured by the board"
    unit = board.profile and board.profile.settings.memory_unit
    total = "" if memory.total_size is None else f" of {memory.total_size:,}"
    doubt = " (implausible: more than there is)" if memory.size > (memory.total_size or memory.size) >= 0 else ""
    return f"{memory.size:,} free{total}{doubt}, {'bytes' if unit else 'in a unit not learnt so far'}"


@Command(
    "board battery",
    help="show the charge of the battery",
    examples=("board battery", "board battery --json"),
    options=(KEEP_MODE,),
)
@on_board(state=UNTOUCHED)
async def run_battery(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Print the charge."""
    percent = await board.battery()
    return Returned(BatteryShown(percent), battery_text(percent))


def battery_text(percent: float | None) -> str:
    """Return the charge of the battery for people."""
    if percent is None:
        return "not measured by the board"
    return f"{percent} %" if percent <= _FULL else f"{percent} % (implausible: beyond {_FULL})"


@Command(
    "board clear",
    help="delete everything stored on the board, after a backup",
    examples=("board clear --yes",),
    options=(flag("--no-backup", "save no backup; what is deleted is lost"), flag("--yes", "do not ask")),
)
@on_board(refuse_without_answer, state=UNTOUCHED)
async def run_clear(args: argparse.Namespace, board: Board, interruption: Interruption) -> Ending:
    """Delete everything, after a backup, and read back that nothing is left."""
    way_out = "without a backup nothing can undo it" if args.no_backup else "`servolink rollback` undoes it"
    ways_out = f"the same command finishes it; {way_out}"
    clearing = BoardImport(args, board, interruption, ways_out, text=changed_text, ask=_question)
    return await clearing.apply(Project(), replace=True, backup=not args.no_backup)


def _question(plan: Plan) -> str:
    return f"delete everything stored on the board ({counted(len(plan.changes), 'change')})?"


@Command(
    "board dummy",
    help="send bytes that the board ignores",
    examples=("board dummy", "board dummy 00ff00ff"),
    options=(option("data", "HEX", f"bytes in hex, at most 65,535 ({_DUMMY.hex()})", nargs="?"),),
)
def run_dummy(args: argparse.Namespace) -> int:
    """Send bytes, and return when the board answers another request."""
    try:
        data = _DUMMY if args.data is None else bytes.fromhex(args.data)
    except ValueError:
        usage_error(args, "HEX must be hex digits in pairs, such as 00ff")

    async def talk(board: Board, interruption: Interruption) -> Returned:
        await board.send_dummy_data(data)
        await board.servo_ids()  # proves that the bytes have left and the board still answers
        return Returned(BytesSent(len(data)), f"{counted(len(data), 'byte')} sent; the board ignored them")

    return run_with_board(args, talk, state=UNTOUCHED)
