"""`servolink board project-id`, `mode`, `memory`, `battery`, `clear` and `dummy`: settings of a connected board."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

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
from servolink.cli.screen.output import counted, print_json, print_result, print_text
from servolink.cli.usage import usage_error
from servolink.errors import ProjectError
from servolink.script import OK

if TYPE_CHECKING:
    from servolink.client.board import Board
    from servolink.project.transfer.results import Plan
    from servolink.protocol.settings import QueryMemorySizeResponse

_DUMMY = bytes(range(16))


@Command(
    "board project-id",
    help="show or write the project id",
    examples=("board project-id", "board project-id 7"),
    options=(option("id", "ID", "write this one; 0: none", whole_number(0, 2**31 - 1), nargs="?"), KEEP_MODE),
)
@on_board(state=UNTOUCHED)
async def run_project_id(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Print the project id, or write a new id and read the id back."""
    from servolink.project.model import is_unfinished

    if args.id is not None:
        await refuse_marker(board, args.id)
        interruption.state = f"project id {args.id} may have been written"
        await board.write_project_id(args.id)
    project_id = await board.project_id()
    if args.id is not None and project_id != args.id:
        raise ProjectError(f"{board.url} accepted project id {args.id}, but reports {project_id}")
    if args.json:
        print_json({"project_id": project_id, "has_unfinished_import": await board.has_unfinished_import()})
    else:
        shown = "none: an import is unfinished" if is_unfinished(project_id) else project_id or "none"
        print_text(f"project id {shown}")
    return OK


async def refuse_marker(board: Board, project_id: int) -> None:
    """Raise ProjectError if `project_id` would mark an unfinished import, or would hide one."""
    from servolink.project.model import UNFINISHED, is_unfinished

    if is_unfinished(project_id):
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
async def run_mode(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Set the transmission mode."""
    interruption.state = f"transmission mode {args.mode} may have been set"
    await board.set_transmission_mode(args.mode)
    print_result(args, {"transmission_mode": args.mode}, f"the board is in transmission mode {args.mode}")
    return OK


@Command(
    "board memory",
    help="show how much memory is free",
    examples=("board memory", "board memory --json"),
    options=(KEEP_MODE,),
)
@on_board(state=UNTOUCHED)
async def run_memory(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Print the memory."""
    memory = await board.memory()
    if args.json:
        print_json({"size_bytes": memory.size, "total_size_bytes": memory.total_size})
    else:
        print_text(f"memory {memory_text(board, memory)}")
    return OK


def memory_text(board: Board, memory: QueryMemorySizeResponse) -> str:
    """Return free and total memory for people, with the unit as far as it was learnt."""
    if memory.size < 0:
        return "not measured by the board"
    unit = board.profile and board.profile.settings.memory_unit
    total = "" if memory.total_size is None else f" of {memory.total_size:,}"
    return f"{memory.size:,} free{total}, {'bytes' if unit else 'in a unit not learnt so far'}"


@Command(
    "board battery",
    help="show the charge of the battery",
    examples=("board battery", "board battery --json"),
    options=(KEEP_MODE,),
)
@on_board(state=UNTOUCHED)
async def run_battery(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Print the charge."""
    percent = await board.battery()
    print_result(args, {"battery_percent": percent}, battery_text(percent))
    return OK


def battery_text(percent: float | None) -> str:
    """Return the charge of the battery for people."""
    return "not measured by the board" if percent is None else f"{percent} %"


@Command(
    "board clear",
    help="delete everything stored on the board, after a backup",
    examples=("board clear --yes",),
    options=(flag("--no-backup", "save no backup; what is deleted is lost"), flag("--yes", "do not ask")),
)
def run_clear(args: argparse.Namespace) -> int:
    """Delete everything, after a backup, and read back that nothing is left."""
    from servolink.cli.projects.apply import BoardImport
    from servolink.cli.stored.change import show_changes
    from servolink.project.model import Project

    refuse_without_answer(args)

    async def talk(board: Board, interruption: Interruption) -> int:
        way_out = "without a backup nothing can undo it" if args.no_backup else "`servolink rollback` undoes it"
        ways_out = f"the same command finishes it; {way_out}"
        clearing = BoardImport(args, board, interruption, ways_out, show=show_changes, ask=_question)
        return await clearing.apply(Project(), replace=True, backup=not args.no_backup)

    return run_with_board(args, talk, state=UNTOUCHED)


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

    async def talk(board: Board, interruption: Interruption) -> int:
        await board.send_dummy_data(data)
        await board.servo_ids()  # proves that the bytes have left and the board still answers
        print_result(args, {"bytes": len(data)}, f"{counted(len(data), 'byte')} sent; the board ignored them")
        return OK

    return run_with_board(args, talk, state=UNTOUCHED)
