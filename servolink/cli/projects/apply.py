"""`servolink plan`, `apply` and `rollback`: make a board hold a project, and restore what was there before."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable, Iterable, Iterator
from typing import Any, Self, TypeVar

from msgspec import UNSET, Struct, UnsetType

from servolink.cli.arguments import file_path, not_empty
from servolink.cli.command import PROJECTS, Command, flag, option
from servolink.cli.command_session import KEEP_MODE, UNTOUCHED, Interruption, refuse_without_answer, run_with_board
from servolink.cli.projects.export import backup_named
from servolink.cli.screen.live import PHASES, shown_progress
from servolink.cli.screen.output import Table, print_error, print_text
from servolink.cli.screen.result import CommandResult, Ending, Part, Remark, Returned, print_for_people
from servolink.cli.screen.terminal import confirm
from servolink.cli.stored.record_tables import change_word, changes_text
from servolink.client import Board
from servolink.errors import ProjectError, ServolinkError, escape
from servolink.project import (
    ApplyResult,
    BackupStore,
    Phase,
    Plan,
    Progress,
    ProgressCallback,
    Project,
    ProjectFile,
    backup_for,
)
from servolink.protocol import record_to_json
from servolink.support import ExitCode

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
    project, unchecked, *_ = ProjectFile.read(args.file)

    async def talk(board: Board, interruption: Interruption) -> Returned:
        with shown_progress(board) as on_progress:
            plan = await board.plan_project(project, replace=args.replace, unchecked=unchecked, on_progress=on_progress)
        text = [*plan_text(plan)]
        if plan.memory is not None and plan.memory.warning:
            text.append(Remark(f"{plan.memory.warning}; `servolink apply` tries it, and nothing is lost by that"))
        return Returned(PlanShown.of(plan), text, ExitCode.FAILED if plan.differs else ExitCode.OK)

    return run_with_board(args, talk, state="nothing was changed")


class PlannedChange(Struct, frozen=True):
    """Change of a record, in the form of project files, or of a number; null for a missing one."""

    what: str
    change: str
    old: Any
    new: Any


class PlannedMemory(Struct, frozen=True):
    """Memory of the board before and after; `unit_bytes` is null for an unknown unit."""

    unit_bytes: int | None
    size_bytes: int | None
    free_before_bytes: int
    free_after_bytes: int | None
    warning: str | None


class PlanShown(CommandResult, frozen=True):
    """JSON of `plan`; `memory` is null for a board without measurement."""

    changes: list[PlannedChange]
    inconsistencies: tuple[str, ...]
    requests: int
    wire_bytes: int
    estimated_seconds: float
    memory: PlannedMemory | None
    is_unfinished: bool

    @classmethod
    def of(cls, plan: Plan) -> Self:
        """Return a plan for programs."""
        changes = [PlannedChange(one.what, change_word(one), _json(one.old), _json(one.new)) for one in plan.changes]
        costs = plan.requests, plan.wire_bytes, plan.seconds
        room, memory = plan.memory, None
        if room is not None:
            memory = PlannedMemory(room.unit, room.size, room.free_before, room.free_after, room.warning or None)
        return cls(changes, plan.inconsistencies, *costs, memory, plan.is_unfinished)


class ContentChanged(CommandResult, frozen=True, kw_only=True):
    """JSON of `apply`, `rollback`, `board clear`, `trim`, `servo rename`, `servo trim` and the commands of records.

    These are `NOUN add`, `NOUN set`, `NOUN rename` and `NOUN delete`. Without a change the result is only `changed`
    and, unless nothing was planned, the plan.
    """

    changed: bool
    resumed: bool | UnsetType = UNSET
    backup: str | UnsetType | None = UNSET
    project_id_bits: int | UnsetType | None = UNSET
    plan: PlanShown | UnsetType = UNSET


def _json(value: Any) -> Any:
    return value if value is None or isinstance(value, int) else record_to_json(value)


def plan_text(plan: Plan) -> Iterator[Part]:
    """Yield a plan for people."""
    if not plan.differs:
        yield "0 differences: the board holds this project"
        return
    yield from changes_text(plan.changes)
    yield from ((f"! {inconsistency}", "yellow") for inconsistency in plan.inconsistencies)
    facts = [
        ("differences", len(plan.changes) + len(plan.inconsistencies)),
        ("transfer", f"{plan.wire_bytes:,} bytes in {plan.requests:,} requests, with backup and verification"),
        ("takes about", f"{max(1, round(plan.seconds))} s"),
        ("memory free", _memory_text(plan)),
    ]
    yield from ("", Table((), facts))


def _memory_text(plan: Plan) -> str:
    """Return the free memory before and after an import as text; before only, as long as its unit is unknown."""
    memory = plan.memory
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
    project, unchecked, *_ = ProjectFile.read(args.file)  # a missing file ends the command before a question is asked
    refuse_without_answer(args)

    async def talk(board: Board, interruption: Interruption) -> Ending:
        ways_out = (
            "the same command finishes it; without a backup nothing can undo it"
            if args.no_backup
            else "nothing is lost: the same command finishes it, `servolink rollback` undoes it"
        )
        importing = BoardImport(args, board, interruption, ways_out)
        store, url = BackupStore(), board.connection.board_url
        if args.yes:  # from now on, a rollback undoes this import or nothing
            await asyncio.to_thread(store.begin, url)
        ending = await importing.apply(project, replace=args.replace, unchecked=unchecked, backup=not args.no_backup)
        await asyncio.to_thread(store.end_beginning, url)
        return ending

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

    async def talk(board: Board, interruption: Interruption) -> Ending:
        path = given or await backup_for(board, store)
        project = store.load(path, board.codec.caption_encoding)
        print_for_people(f"from {path}")
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
        text: Callable[[Plan], Iterable[Part]] = plan_text,
        ask: Callable[[Plan], str] | None = None,
    ) -> None:
        """`ways_out` says how to get out of an unfinished import; `text` is what will be done, for people.

        `ask` returns the question before it, in place of `question`; with `args.yes` nothing is asked.
        """
        self._args = args
        self._board = board
        self._interruption = interruption
        self._ways_out = ways_out
        self._text = text
        self._ask = ask or question

    async def apply(self, project: Project, *, replace: bool, unchecked: bool = False, backup: bool = True) -> Ending:
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
    ) -> Ending:
        """Import after a yes. Raise ProjectError if the plan changed before the answer came."""
        plan = await self._with_progress(make_plan)
        print_for_people(self._text(plan))
        if not plan.differs and not await self._board.has_unfinished_import():
            return Returned(ContentChanged(changed=False, plan=PlanShown.of(plan)))
        if plan.differs and not self._args.yes:
            if not await confirm(self._ask(plan)):
                print_text(UNTOUCHED)
                return ExitCode.FAILED
            if _content(await self._with_progress(make_plan)) != _content(plan):
                raise ProjectError(
                    f"the content of {self._board.url} changed before the answer, and so did the plan; "
                    f"{UNTOUCHED} by this command: look at the new plan"
                )
        try:
            result = await self._with_progress(lambda show: work(lambda progress: self._note(progress, show)))
        except ProjectError:  # refused: the same command would be refused again
            print_error(f"servolink: {escape(self._interruption.state.replace(self._ways_out, _AFTER_REFUSAL))}")
            raise
        except ServolinkError:
            print_error(f"servolink: {escape(self._interruption.state)}")
            raise
        self._interruption.state = "the import is finished"
        done = ContentChanged(
            changed=result.changed,
            resumed=result.resumed,
            backup=None if result.backup is None else str(result.backup),
            project_id_bits=result.project_id_bits,
            plan=PlanShown.of(plan),
        )
        return Returned(done, self._done_text(result))

    async def _with_progress(self, work: Callable[[ProgressCallback], Awaitable[T]]) -> T:
        with shown_progress(self._board) as on_progress:
            return await work(on_progress)

    def _note(self, progress: Progress, show: ProgressCallback) -> None:
        show(progress)
        if progress.phase not in ("reading", "saving"):
            self._interruption.state = (
                f"{_LEFT.get(progress.phase, 'the board holds an unfinished import')}, stopped while "
                f"{PHASES[progress.phase]}, at {progress.item} ({progress.done} of {progress.total}); {self._ways_out}"
            )

    def _done_text(self, result: ApplyResult) -> Iterator[Part]:
        yield "done, and verified: each record was read back from the board", "green"
        if result.project_id_bits is not None and (protection := _PROTECTION.get(result.project_id_bits)):
            yield protection, "yellow"
        if result.backup and not (result.resumed and self._args.command == "rollback"):
            what = "content before the unfinished import" if result.resumed else "content before"
            yield f"the {what} is saved in {result.backup}; `servolink rollback` restores it"


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
_AFTER_REFUSAL = (
    "`servolink rollback` writes back what was there before, as far as the board accepts it, and `servolink board "
    "clear` empties the board"
)
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
