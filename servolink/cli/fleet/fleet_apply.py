"""`servolink fleet apply` and `servolink fleet export`: what is stored on many boards."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from servolink.cli.arguments import file_path, whole_number
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import Interruption, agreed, refuse_unasked, refuse_without_answer, run_interruptible
from servolink.cli.fleet.broker_options import BROKER, GROUPS, boards_of
from servolink.cli.screen.live import PHASES
from servolink.cli.screen.output import Table, counted, print_error, print_json, print_table, print_text
from servolink.cli.screen.terminal import confirm
from servolink.script import FAILED, OK

if TYPE_CHECKING:
    from servolink.control.messages import Applied
    from servolink.errors import ServolinkError
    from servolink.fleet.client import Fleet
    from servolink.fleet.each import Outcomes
    from servolink.fleet.topics import Step
    from servolink.fleet.transfer import BoardPlan
    from servolink.project.model import Project

_MOST_PARALLEL = 200
_UNCHANGED = "no board was changed"


_CHOICE = (
    option("--parallel", "N", "boards at a time (8)", whole_number(1, _MOST_PARALLEL), default=8),
    *GROUPS,
    *BROKER,
)


# --- apply ------------------------------------------------------------------------------------------------------------


@Command(
    "fleet apply",
    help="make many boards hold what a project file holds, after a backup of each",
    examples=("fleet apply robot.servolink.json --yes", "fleet apply robot.servolink.json --on rex --parallel 1 --yes"),
    options=(
        option("file", "FILE", "a project file", file_path),
        flag("--replace", "delete everything first, instead of what differs only"),
        flag("--no-backup", "keep no backups"),
        flag("--fail-fast", "begin no further board after a failure"),
        flag("--yes", "do not ask"),
        *_CHOICE,
    ),
    takes_board=False,
)
def run_apply(args: argparse.Namespace) -> int:
    """Show the changes of each board, ask, and write to all boards with changes."""
    from servolink.project.project_file import read_project_file

    project, unchecked, *_ = read_project_file(args.file)  # a missing file ends the command before a question is asked
    refuse_without_answer(args)

    async def main(interruption: Interruption) -> int:
        async with boards_of(args) as fleet:
            return await _Apply(args, fleet, interruption, project, unchecked=unchecked).run()

    return run_interruptible(main, _UNCHANGED)


class _Apply:
    """One import to many boards."""

    def __init__(
        self, args: argparse.Namespace, fleet: Fleet, interruption: Interruption, project: Project, *, unchecked: bool
    ) -> None:
        self._args = args
        self._fleet = fleet
        self._interruption = interruption
        self._project = project
        self._unchecked = unchecked

    async def run(self) -> int:
        """Plan, ask and import. Return the exit code."""
        from servolink.fleet.transfer import Transfer

        args, boards = self._args, self._fleet.boards(self._args.on or "all")
        with _progress("comparing", len(boards), quiet=args.json) as (on_step, on_outcome):
            each = Transfer(
                self._fleet.controller, boards, parallel=args.parallel, on_step=on_step, on_outcome=on_outcome
            )
            plans = await each.plan(self._project, replace=args.replace, unchecked=self._unchecked)
        there = {board: plan for board, plan in plans.done.items() if plan.differs}
        if not args.json:
            print_table(_plan_table(plans))
        if plans.failed and args.fail_fast:
            there = {}
        if there and not args.yes and not await confirm(_question(there)):
            print_text(_UNCHANGED)
            return FAILED
        applied = await self._apply(list(there))
        self._report(plans, applied)
        return OK if plans.is_complete and applied.is_complete else FAILED

    async def _apply(self, boards: list[str]) -> Outcomes[Applied]:
        from servolink.fleet.transfer import Transfer

        args, left = self._args, dict.fromkeys(boards)
        with _progress("writing", len(boards), quiet=args.json) as (on_step, on_outcome):

            def ended(board: str, error: ServolinkError | None) -> None:
                del left[board]
                on_outcome(board, error)
                self._interruption.state = (
                    f"{counted(len(boards) - len(left), 'board')} of {len(boards)} done; what was begun on the others "
                    "goes on there by itself, and the same command does the rest"
                )

            if boards:
                self._interruption.state = (
                    "what was begun on boards goes on there by itself; the same command does the rest"
                )
            each = Transfer(
                self._fleet.controller,
                boards,
                parallel=args.parallel,
                fail_fast=args.fail_fast,
                on_step=on_step,
                on_outcome=ended,
            )
            return await each.apply(
                self._project, replace=args.replace, unchecked=self._unchecked, backup=not args.no_backup
            )

    def _report(self, plans: Outcomes[BoardPlan], applied: Outcomes[Applied]) -> None:
        same = [board for board, plan in plans.done.items() if not plan.differs]
        failed = {board: str(error) for board, error in {**plans.failed, **applied.failed}.items()}
        not_begun = [
            board
            for board, plan in plans.done.items()
            if plan.differs and board not in applied.done and board not in applied.failed
        ]
        if self._args.json:
            done = {board: {"resumed": each.resumed, "backup": each.backup} for board, each in applied.done.items()}
            print_json({"done": done, "unchanged": same, "failed": failed, "not_begun": not_begun})
            return
        if applied.done:
            names = ", ".join(sorted(applied.done))
            print_text(f"done, and verified, on {counted(len(applied.done), 'board')}: {names}", "green")
        if same:
            print_text(f"held it already: {', '.join(sorted(same))}")
        for board, text in failed.items():
            print_error(f"servolink: {text if board in text else f'{board}: {text}'}")
        if not_begun:
            print_error(f"servolink: not begun: {', '.join(not_begun)}")
        if failed or not_begun:
            print_error("servolink: run the same command again for these boards; finished boards are not written again")


def _plan_table(plans: Outcomes[BoardPlan]) -> Table:
    """Return a row for each board: what would change there."""
    rows: list[tuple[str, str, str, str]] = []
    for board, plan in sorted(plans.done.items()):
        if not plan.differs:
            rows.append((board, "0 differences", "", ""))
            continue
        changes = counted(len(plan.what) + len(plan.inconsistencies), "difference")
        deleted = f"deletes {counted(len(plan.deleted), 'record')}" if plan.deleted else ""
        notes = [
            deleted,
            "continues an unfinished import" if plan.is_unfinished else "",
            plan.warning and "may not fit",
        ]
        rows.append((board, changes, f"{max(1, round(plan.seconds))} s", ", ".join(filter(None, notes))))
    rows += [(board, "cannot be compared", "", "see below") for board in plans.failed]
    return Table(("board", "would change", "takes about", ""), rows)


def _question(plans: dict[str, BoardPlan]) -> str:
    deleting = [board for board, plan in plans.items() if plan.deleted]
    boards = counted(len(plans), "board")
    if not deleting:
        return f"write this to {boards}?"
    return f"write this to {boards}, and delete records from {', '.join(deleting)}?"


# --- export -----------------------------------------------------------------------------------------------------------


@Command(
    "fleet export",
    help="write the content of each board into a project file",
    examples=("fleet export boards --yes",),
    options=(
        option("folder", "FOLDER", "for a file BOARD.servolink.json of each board", file_path),
        flag("--yes", "replace project files without asking"),
        *_CHOICE,
    ),
    takes_board=False,
)
def run_export(args: argparse.Namespace) -> int:
    """Write a file for each board, after asking if there are some already."""
    from servolink.errors import ProjectError

    if args.folder.exists() and not args.folder.is_dir():
        raise ProjectError(f"{args.folder} is not a folder; choose another name")

    async def main(interruption: Interruption) -> int:
        async with boards_of(args) as fleet:
            return await _export(args, fleet, interruption)

    return run_interruptible(main, "no file was written")


async def _export(args: argparse.Namespace, fleet: Fleet, interruption: Interruption) -> int:
    from servolink.fleet.transfer import Transfer, export_path

    boards = fleet.boards(args.on or "all")
    there = [path.name for board in boards if (path := export_path(args.folder, board)).exists()]
    if there:
        held = f"{args.folder} holds {', '.join(there)} already"
        refuse_unasked(args, f"{held}; --yes replaces them")
        if not await agreed(args, interruption, f"{held}. Replace them?"):
            return FAILED
    args.folder.mkdir(parents=True, exist_ok=True)
    interruption.state = f"some files in {args.folder} may be written, each whole"
    with _progress("reading", len(boards), quiet=args.json) as (on_step, on_outcome):
        each = Transfer(fleet.controller, boards, parallel=args.parallel, on_step=on_step, on_outcome=on_outcome)
        outcomes = await each.export(args.folder)
    failed = {board: str(error) for board, error in outcomes.failed.items()}
    if args.json:
        print_json({"files": {board: str(path) for board, path in outcomes.done.items()}, "failed": failed})
    else:
        for path in outcomes.done.values():
            print_text(str(path))
        for board, text in failed.items():
            print_error(f"servolink: {text if board in text else f'{board}: {text}'}")
    return OK if outcomes.is_complete else FAILED


# --- progress ---------------------------------------------------------------------------------------------------------


@contextmanager
def _progress(label: str, total: int, *, quiet: bool) -> Iterator[tuple[_OnStep, _OnOutcome]]:
    """Yield callbacks that draw a bar of finished boards and the progress of the latest unfinished board."""
    import sys

    if quiet or not total or sys.stderr is None or not sys.stderr.isatty():
        yield (lambda board, step: None), (lambda board, error: None)
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    from servolink.cli.screen.output import console
    from servolink.cli.screen.terminal import cleanup
    from servolink.escaping import escape

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[item]}", markup=False),
    )
    displayed = console(stderr=True)
    with cleanup(displayed.show_cursor), Bar(*columns, console=displayed, transient=True) as bar:
        task = bar.add_task(label, total=total, item="")

        def on_step(board: str, step: Step) -> None:
            bar.update(task, item=escape(f"{board}: {PHASES[step.phase]} {step.done} of {step.total}"))

        def on_outcome(board: str, error: ServolinkError | None) -> None:
            bar.advance(task)

        yield on_step, on_outcome


if TYPE_CHECKING:
    from collections.abc import Callable

    _OnStep = Callable[[str, Step], None]
    _OnOutcome = Callable[[str, ServolinkError | None], None]
