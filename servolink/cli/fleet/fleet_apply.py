"""`servolink fleet apply` and `servolink fleet export`: what is stored on many boards."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import file_path, whole_number
from servolink.cli.command import Command, flag, option
from servolink.cli.command_session import Interruption, agreed, interruptible, refuse_unasked, refuse_without_answer
from servolink.cli.fleet.broker_options import BROKER, GROUPS, boards_of
from servolink.cli.screen.live import PHASES, draws_progress, progress_bar
from servolink.cli.screen.output import Table, counted
from servolink.cli.screen.result import CommandResult, Ending, Part, Remark, Returned, print_for_people
from servolink.cli.screen.terminal import confirm
from servolink.control import Applied
from servolink.errors import ProjectError, ServolinkError, escape
from servolink.project import Project, ProjectFile
from servolink.support import ExitCode

if TYPE_CHECKING:
    from servolink.fleet import BoardPlan, Fleet, Outcomes, TransferStep

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
@interruptible(_UNCHANGED)
async def run_apply(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Show the changes of each board, ask, and write to all boards with changes."""
    project, unchecked, *_ = ProjectFile.read(args.file)  # a missing file ends the command before a question is asked
    refuse_without_answer(args)
    async with boards_of(args) as fleet:
        return await _Apply(args, fleet, interruption, project, unchecked=unchecked).run()


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

    async def run(self) -> Ending:
        """Plan, ask and import."""
        from servolink.fleet import Transfer

        args, boards = self._args, self._fleet.boards(self._args.on or "all")
        with _progress("comparing", len(boards)) as (on_step, on_outcome):
            each = Transfer(
                self._fleet.controller, boards, parallel=args.parallel, on_step=on_step, on_outcome=on_outcome
            )
            plans = await each.plan(self._project, replace=args.replace, unchecked=self._unchecked)
        there = {board: plan for board, plan in plans.done.items() if plan.differs}
        print_for_people(_plan_table(plans))
        if plans.failed and args.fail_fast:
            there = {}
        if there and not args.yes and not await confirm(_question(there)):
            print_for_people(_UNCHANGED)
            return ExitCode.FAILED
        return _applied(plans, await self._apply(list(there)))

    async def _apply(self, boards: list[str]) -> Outcomes[Applied]:
        from servolink.fleet import Transfer

        args, left = self._args, dict.fromkeys(boards)
        with _progress("writing", len(boards)) as (on_step, on_outcome):

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


class FleetApplied(CommandResult, frozen=True, kw_only=True):
    """JSON of `fleet apply`: boards by how it went; finished boards with backup."""

    done: dict[str, dict[str, Any]]
    unchanged: list[str]
    failed: dict[str, str]
    not_begun: list[str]


class FleetExported(CommandResult, frozen=True):
    """JSON of `fleet export`: files and failures by board."""

    files: dict[str, str]
    failed: dict[str, str]


def _applied(plans: Outcomes[BoardPlan], applied: Outcomes[Applied]) -> Returned:
    differing = [board for board, plan in plans.done.items() if plan.differs]
    value = FleetApplied(
        done={board: {"resumed": each.resumed, "backup": each.backup} for board, each in applied.done.items()},
        unchanged=[board for board in plans.done if board not in differing],
        failed={board: str(error) for board, error in {**plans.failed, **applied.failed}.items()},
        not_begun=[board for board in differing if board not in applied.done and board not in applied.failed],
    )
    is_complete = plans.is_complete and applied.is_complete
    return Returned(value, _applied_text(value), ExitCode.OK if is_complete else ExitCode.FAILED)


def _applied_text(applied: FleetApplied) -> Iterator[Part]:
    if applied.done:
        names = ", ".join(sorted(applied.done))
        yield f"done, and verified, on {counted(len(applied.done), 'board')}: {names}", "green"
    if applied.unchanged:
        yield f"held it already: {', '.join(sorted(applied.unchanged))}"
    yield from _failures(applied.failed)
    if applied.not_begun:
        yield Remark(f"not begun: {', '.join(applied.not_begun)}")
    if applied.failed or applied.not_begun:
        yield Remark("run the same command again for these boards; finished boards are not written again")


def _failures(failed: dict[str, str]) -> Iterator[Remark]:
    return (Remark(text if board in text else f"{board}: {text}") for board, text in failed.items())


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
@interruptible("no file was written")
async def run_export(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Write a file for each board, after asking if there are some already."""
    if args.folder.exists() and not args.folder.is_dir():
        raise ProjectError(f"{args.folder} is not a folder; choose another name")
    async with boards_of(args) as fleet:
        return await _export(args, fleet, interruption)


async def _export(args: argparse.Namespace, fleet: Fleet, interruption: Interruption) -> Ending:
    from servolink.fleet import Transfer

    boards = fleet.boards(args.on or "all")
    there = [path.name for board in boards if (path := Transfer.export_path(args.folder, board)).exists()]
    if there:
        held = f"{args.folder} holds {', '.join(there)} already"
        refuse_unasked(args, f"{held}; --yes replaces them")
        if not await agreed(args, interruption, f"{held}. Replace them?"):
            return ExitCode.FAILED
    args.folder.mkdir(parents=True, exist_ok=True)
    interruption.state = f"some files in {args.folder} may be written, each whole"
    with _progress("reading", len(boards)) as (on_step, on_outcome):
        each = Transfer(fleet.controller, boards, parallel=args.parallel, on_step=on_step, on_outcome=on_outcome)
        outcomes = await each.export(args.folder)
    failed = {board: str(error) for board, error in outcomes.failed.items()}
    files = {board: str(path) for board, path in outcomes.done.items()}
    code = ExitCode.OK if outcomes.is_complete else ExitCode.FAILED
    return Returned(FleetExported(files, failed), [*files.values(), *_failures(failed)], code)


# --- progress ---------------------------------------------------------------------------------------------------------


@contextmanager
def _progress(label: str, total: int) -> Iterator[tuple[_OnStep, _OnOutcome]]:
    """Yield callbacks that draw a bar of finished boards and the progress of the latest unfinished board."""
    if not total or not draws_progress():
        yield (lambda board, step: None), (lambda board, error: None)
        return
    with progress_bar(label, total) as (bar, task):

        def on_step(board: str, step: TransferStep) -> None:
            bar.update(task, item=escape(f"{board}: {PHASES[step.phase]} {step.done} of {step.total}"))

        yield on_step, lambda board, error: bar.advance(task)


if TYPE_CHECKING:
    from collections.abc import Callable

    _OnStep = Callable[[str, TransferStep], None]
    _OnOutcome = Callable[[str, ServolinkError | None], None]
