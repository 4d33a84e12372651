"""`servolink plan`: what an import would change on the board."""

from __future__ import annotations

import argparse
from typing import Any

from servolink.cli.arguments import file_path
from servolink.cli.command import PROJECTS, Command, flag, option
from servolink.cli.command_session import Interruption, run_with_board
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.output import Table, print_error, print_json, print_table, print_text
from servolink.cli.stored.record_tables import change_word, print_changes
from servolink.client.board import Board
from servolink.project.project_file import read_project_file
from servolink.project.transfer.results import Memory, Plan
from servolink.protocol.json_form import record_to_json
from servolink.script import FAILED, OK


@Command(
    "plan",
    PROJECTS,
    help="show what a project file would change on the board",
    examples=("plan robot.servolink.json", "plan robot.servolink.json --replace --json"),
    options=(
        option("file", "FILE", "a project file", file_path),
        flag("--replace", "as for `servolink apply --replace`"),
    ),
)
def run(args: argparse.Namespace) -> int:
    """Print the differences; return 0 if there are none, else 1."""
    project, unchecked, _ = read_project_file(args.file)

    async def talk(board: Board, interruption: Interruption) -> int:
        with shown_progress(board, quiet=args.json) as on_progress:
            plan = await board.plan_project(project, replace=args.replace, unchecked=unchecked, on_progress=on_progress)
        if args.json:
            print_json(plan_to_json(plan))
        else:
            print_plan(plan)
            if plan.memory is not None and plan.memory.warning:
                print_error(
                    f"servolink: {plan.memory.warning}; `servolink apply` tries it, and nothing is lost by that"
                )
        return FAILED if plan.differs else OK

    return run_with_board(args, talk, state="nothing was changed")


def plan_to_json(plan: Plan) -> dict[str, object]:
    """Return a plan for programs, with records in the form of project files."""
    changes = [
        {"what": one.what, "change": change_word(one), "old": _to_json(one.old), "new": _to_json(one.new)}
        for one in plan.changes
    ]
    return {
        "changes": changes,
        "inconsistencies": list(plan.inconsistencies),
        "requests": plan.requests,
        "wire_bytes": plan.wire_bytes,
        "estimated_seconds": plan.seconds,
        "memory": None if plan.memory is None else memory_to_json(plan.memory),
        "is_unfinished": plan.is_unfinished,
    }


def memory_to_json(memory: Memory) -> dict[str, object]:
    """Return the memory of a plan for programs."""
    return {
        "unit_bytes": memory.unit,
        "size_bytes": memory.size,
        "free_before_bytes": memory.free_before,
        "free_after_bytes": memory.free_after,
        "warning": memory.warning or None,
    }


def _to_json(value: Any) -> Any:
    return value if value is None or isinstance(value, int) else record_to_json(value)


def print_plan(plan: Plan) -> None:
    """Print a plan for people."""
    if not plan.differs:
        print_text("0 differences: the board holds this project")
        return
    print_changes(plan.changes)
    for inconsistency in plan.inconsistencies:
        print_text(f"! {inconsistency}", "yellow")
    facts = [
        ("differences", len(plan.changes) + len(plan.inconsistencies)),
        ("transfer", f"{plan.wire_bytes:,} bytes in {plan.requests:,} requests, with backup and verification"),
        ("takes about", f"{max(1, round(plan.seconds))} s"),
        ("memory free", _memory_text(plan.memory)),
    ]
    print_text("")
    print_table(Table((), facts))


def _memory_text(memory: Memory | None) -> str:
    """Return the free memory before and after an import, in bytes, as text."""
    if memory is None:
        return "unknown, the board does not say"
    size = "" if memory.size is None else f" of {memory.size:,}"
    doubt = ": the project may not fit" if memory.warning else ""
    return f"{memory.free_before:,} bytes{size}, afterwards {memory.free_after:,}{doubt}"
