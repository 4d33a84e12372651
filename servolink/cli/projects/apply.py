"""`servolink plan`, `apply` and `rollback`: make a board hold a project, and restore what was there before."""

from __future__ import annotations

import argparse
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from servolink.cli.arguments import file_path, not_empty
from servolink.cli.command import PROJECTS, Command, flag, option
from servolink.cli.command_session import KEEP_MODE, UNTOUCHED, Interruption, refuse_without_answer, run_with_board
from servolink.cli.projects.export import backup_named
from servolink.cli.screen.live import PHASES, shown_progress
from servolink.cli.screen.output import Table, print_error, print_json, print_table, print_text
from servolink.cli.screen.terminal import confirm
from servolink.cli.stored.record_tables import change_word, print_changes
from servolink.client.board import Board
from servolink.errors import ProjectError, ServolinkError
from servolink.escaping import escape
from servolink.project.model import Project
from servolink.project.project_file import read_project_file
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.importing import backup_for
from servolink.project.transfer.results import ApplyResult, Memory, Phase, Plan, Progress, ProgressCallback
from servolink.protocol.json_form import record_to_json
from servolink.script import FAILED, OK

T = TypeVar("T")

_NAMED = 5  # records that the question names


@Command(
    "plan",
    PROJECTS,
    help="show what a project file would change on the board",
    examples=("plan robot.servolink.json", "plan robot.servolink.json --replace --json"),
    options=(
        option("file", "FILE", "a project file", file_path),
        flag("--replace", "as for `servolink apply --replace`"),
        KEEP_MODE,
    ),
)
def run_plan(args: argparse.Namespace) -> int:
    """Print the differences; return 0 if there are none, else 1."""
    project, unchecked, *_ = read_project_file(args.file)

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
    """Return the free memory before and after an import as text; before only, as long as its unit is unknown."""
    if memory is None:
        return "unknown, the board does not say"
    size = "" if memory.size is None else f" of {memory.size:,}"
    doubt = ": the project may not fit" if memory.warning else ""
    if memory.unit is None:
        return f"{memory.free_before:,}{size}, in a unit not learnt so far{doubt}"
    return f"{memory.free_before:,} bytes{size}, afterwards {memory.free_after:,}{doubt}"


@Command(
    "apply",
    PROJECTS,
    help="make the board hold what a project file holds, after a backup",
    details="The board then holds exactly what the file holds: records that the file lacks are deleted. Before "
    "anything changes, the content of the board is saved in a backup, which `servolink rollback` restores.",
    examples=("apply robot.servolink.json --yes", "apply robot.servolink.json --replace --yes"),
    options=(
        option("file", "FILE", "a project file", file_path),
        flag("--replace", "if anything differs, delete and write everything"),
        flag("--no-backup", "save no backup; what is replaced is lost"),
        flag("--yes", "do not ask"),
    ),
)
def _apply(args: argparse.Namespace) -> int:
    project, unchecked, *_ = read_project_file(args.file)  # a missing file ends the command before a question is asked
    refuse_without_answer(args)

    async def talk(board: Board, interruption: Interruption) -> int:
        ways_out = (
            "the same command finishes it; without a backup nothing can undo it"
            if args.no_backup
            else "nothing is lost: the same command finishes it, `servolink rollback` undoes it"
        )
        importing = BoardImport(args, board, interruption, ways_out)
        return await importing.apply(project, replace=args.replace, unchecked=unchecked, backup=not args.no_backup)

    return run_with_board(args, talk, state=UNTOUCHED)


@Command(
    "rollback",
    PROJECTS,
    help="bring back what was on the board before the last import",
    examples=("rollback --yes",),
    options=(
        option("backup", "BACKUP", "a number of `servolink backups`, or a file (the last)", not_empty, nargs="?"),
        flag("--yes", "do not ask"),
    ),
    needs_records=True,
)
def _roll_back(args: argparse.Namespace) -> int:
    given = backup_named(args.backup) if args.backup else None
    store = BackupStore()
    if given:
        store.load(given)  # a missing or damaged file ends the command before a question is asked
    refuse_without_answer(args)

    async def talk(board: Board, interruption: Interruption) -> int:
        path = given or await backup_for(board, store)
        project = store.load(path, board.codec.caption_encoding)
        if not args.json:
            print_text(f"from {path}")

        importing = BoardImport(args, board, interruption, "nothing is lost: the same command finishes it")
        return await importing.run(
            lambda show: board.plan_project(project, unchecked=True, on_progress=show),
            lambda show: board.rollback_project(path, on_progress=show),
        )

    return run_with_board(args, talk, state=UNTOUCHED)


class BoardImport:
    """Shows the plan, asks, imports, and keeps the interruption's state up to date."""

    def __init__(
        self,
        args: argparse.Namespace,
        board: Board,
        interruption: Interruption,
        ways_out: str,
        *,
        show: Callable[[Plan], None] = print_plan,
        ask: Callable[[Plan], str] | None = None,
    ) -> None:
        """`ways_out` says how to get out of an unfinished import; `show` prints what will be done.

        `ask` returns the question before it, in place of `question`; with `args.yes` nothing is asked.
        """
        self._args = args
        self._board = board
        self._interruption = interruption
        self._ways_out = ways_out
        self._show = show
        self._ask = ask or question

    async def apply(self, project: Project, *, replace: bool, unchecked: bool = False, backup: bool = True) -> int:
        """Make the board hold `project`, after a yes (see `run`)."""
        options: dict[str, Any] = {"replace": replace, "unchecked": unchecked}
        return await self.run(
            lambda show: self._board.plan_project(project, **options, on_progress=show),
            lambda show: self._board.apply_project(project, **options, backup=backup, on_progress=show),
        )

    async def run(
        self,
        make_plan: Callable[[ProgressCallback], Awaitable[Plan]],
        work: Callable[[ProgressCallback], Awaitable[ApplyResult]],
    ) -> int:
        """Import after a yes. Raise ProjectError if the plan changed before the answer came."""
        plan = await self._with_progress(make_plan)
        if not self._args.json:
            self._show(plan)
        if not plan.differs:
            if self._args.json:
                print_json({"changed": False, "plan": plan_to_json(plan)})
            return OK
        if not self._args.yes:
            if not await confirm(self._ask(plan)):
                print_text(UNTOUCHED)
                return FAILED
            if _content(await self._with_progress(make_plan)) != _content(plan):
                raise ProjectError(
                    f"the content of {self._board.url} changed before the answer, and so did the plan; "
                    f"{UNTOUCHED} by this command: look at the new plan"
                )
        try:
            result = await self._with_progress(lambda show: work(lambda progress: self._note(progress, show)))
        except ServolinkError:
            print_error(f"servolink: {escape(self._interruption.state)}")
            raise
        self._report(plan, result)
        return OK

    async def _with_progress(self, work: Callable[[ProgressCallback], Awaitable[T]]) -> T:
        with shown_progress(self._board, quiet=self._args.json) as on_progress:
            return await work(on_progress)

    def _note(self, progress: Progress, show: ProgressCallback) -> None:
        show(progress)
        if progress.phase not in ("reading", "saving"):
            self._interruption.state = (
                f"{_LEFT.get(progress.phase, 'the board holds an unfinished import')}, stopped while "
                f"{PHASES[progress.phase]}, at {progress.item} ({progress.done} of {progress.total}); {self._ways_out}"
            )

    def _report(self, plan: Plan, result: ApplyResult) -> None:
        self._interruption.state = "the import is finished"
        backup = result.backup and str(result.backup)
        if self._args.json:
            described = {
                "changed": result.changed,
                "resumed": result.resumed,
                "backup": backup,
                "project_id_bits": result.project_id_bits,
            }
            print_json({**described, "plan": plan_to_json(plan)})
            return
        print_text("done, and verified: each record was read back from the board", "green")
        if result.project_id_bits is not None and (protection := _PROTECTION.get(result.project_id_bits)):
            print_text(protection, "yellow")
        if backup and not (result.resumed and self._args.command == "rollback"):
            what = "content before the unfinished import" if result.resumed else "content before"
            print_text(f"the {what} is saved in {backup}; `servolink rollback` restores it")


_PROTECTION = {
    16: (
        "this board keeps 16 bits of a project id, so an interrupted import is recognised only from this computer and "
        "at this address"
    ),
    0: (
        "this board keeps no project id, so an interrupted import is recognised only from this computer, at this "
        "address, by what is on the board; two programs that import at the same time do not notice each other"
    ),
}
"""Text about the protection of an import, by the number of bits of a project id stored on the board."""
_LEFT: dict[Phase, str] = {
    "marking": "the board may say that it holds an unfinished import, but nothing else was changed",
    "finishing": "everything is written, but the board may still say that the import is unfinished",
}


def question(plan: Plan) -> str:
    """Return the question before an import, with the records to be deleted."""
    deleted = [one.what for one in plan.changes if one.new is None and not isinstance(one.old, int)]
    if not deleted:
        return "write this to the board?"
    more = f" and {len(deleted) - _NAMED} more" if len(deleted) > _NAMED else ""
    return f"write this to the board, and delete {', '.join(deleted[:_NAMED])}{more} from it?"


def _content(plan: Plan) -> object:
    """Return the changes of a plan, without the costs."""
    return plan.changes, plan.inconsistencies, plan.is_unfinished
