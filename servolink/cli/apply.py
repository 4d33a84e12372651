"""`servolink apply` and `servolink rollback`: a project onto a board, and what was there before back again."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

from servolink.cli.arguments import not_empty
from servolink.cli.export import backup_named
from servolink.cli.live import PHASES, shown_progress
from servolink.cli.main import FAILED, OK, usage_error
from servolink.cli.output import print_json, print_text
from servolink.cli.plan import plan_object, print_plan
from servolink.cli.session import Interruption, run_with_board
from servolink.cli.terminal import can_ask, confirm
from servolink.client.board import Board
from servolink.errors import ProjectError, ServolinkError
from servolink.escaping import escape
from servolink.project.project_file import load_project
from servolink.project.transfer.apply import backup_for
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.results import ApplyResult, Phase, Plan, Progress, ProgressCallback

_UNTOUCHED = "nothing was changed on the board"


def configure_rollback(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink rollback`."""
    parser.set_defaults(run=run)
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument(
        "backup",
        nargs="?",
        type=not_empty,
        metavar="BACKUP",
        help="a number of `servolink backups`, or a file (the last)",
    )


def configure_apply(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink apply`."""
    parser.set_defaults(run=run)
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument("file", type=Path, metavar="FILE", help="a project file")
    parser.add_argument(
        "--replace", action="store_true", help="delete everything on the board first, instead of only what differs"
    )
    parser.add_argument(
        "--no-backup", action="store_true", help="keep nothing of what is on the board; what is replaced is lost"
    )


def run(args: argparse.Namespace) -> int:
    """Show what would change, ask, and do it."""
    if not args.yes and args.json:
        usage_error(args, "--json asks nothing; --yes goes on without asking")
    if not (args.yes or can_ask()):
        usage_error(args, "there is no terminal to ask on; --yes goes on without asking")
    return _apply(args) if args.command == "apply" else _roll_back(args)


def _apply(args: argparse.Namespace) -> int:
    project = load_project(args.file)

    async def talk(board: Board, interruption: Interruption) -> int:
        async def work(on_progress: ProgressCallback) -> ApplyResult:
            return await board.apply_project(
                project, replace=args.replace, backup=not args.no_backup, on_progress=on_progress
            )

        async def plan(on_progress: ProgressCallback) -> Plan:
            return await board.plan_project(project, replace=args.replace, on_progress=on_progress)

        ways = (
            "the same command goes on; without a backup nothing goes back"
            if args.no_backup
            else "nothing is lost: the same command goes on, `servolink rollback` goes back"
        )
        return await _Change(args, board, interruption, ways).make(plan, work)

    return run_with_board(args, talk, state=_UNTOUCHED)


def _roll_back(args: argparse.Namespace) -> int:
    named = backup_named(args.backup) if args.backup else None
    store = BackupStore()
    named_project = store.load(named, args.caption_encoding) if named else None

    async def talk(board: Board, interruption: Interruption) -> int:
        path = named or await backup_for(board, store)
        project = named_project or store.load(path, args.caption_encoding)
        if not args.json:
            print_text(f"from {path}")

        async def plan(on_progress: ProgressCallback) -> Plan:
            return await board.plan_project(project, unchecked=True, on_progress=on_progress)

        async def work(on_progress: ProgressCallback) -> ApplyResult:
            return await board.rollback_project(path, on_progress=on_progress)

        return await _Change(args, board, interruption, "nothing is lost: the same command goes on").make(plan, work)

    return run_with_board(args, talk, state=_UNTOUCHED)


class _Change:
    """Asks, works, and keeps true what Ctrl-C or an error says."""

    def __init__(self, args: argparse.Namespace, board: Board, interruption: Interruption, ways: str) -> None:
        """`ways` are those out of an unfinished import."""
        self._args = args
        self._board = board
        self._interruption = interruption
        self._ways = ways

    async def make(
        self,
        planned: Callable[[ProgressCallback], Awaitable[Plan]],
        work: Callable[[ProgressCallback], Awaitable[ApplyResult]],
    ) -> int:
        """Do what is planned, if it is wanted; ProjectError if it is not the same any more when the answer comes."""
        plan = await self._shown(planned)
        if not self._args.json:
            print_plan(plan)
        if not plan.differs:
            if self._args.json:
                print_json({"changed": False, "plan": plan_object(plan)})
            return OK
        if not (self._args.yes or await confirm("do it?")):
            print_text(_UNTOUCHED)
            return FAILED
        if not self._args.yes and _done(await self._shown(planned)) != _done(plan):
            raise ProjectError(
                f"what is on {escape(self._board.url)} has changed meanwhile, and so has what would be done; "
                f"{_UNTOUCHED} by this command: look at the new plan"
            )
        try:
            with shown_progress(self._board, quiet=self._args.json) as on_progress:
                applied = await work(lambda progress: self._note(progress, on_progress))
        except ServolinkError:
            print(f"servolink: {self._interruption.state}", file=sys.stderr)
            raise
        self._report(plan, applied)
        return OK

    async def _shown(self, planned: Callable[[ProgressCallback], Awaitable[Plan]]) -> Plan:
        with shown_progress(self._board, quiet=self._args.json) as on_progress:
            return await planned(on_progress)

    def _note(self, progress: Progress, on_progress: ProgressCallback) -> None:
        on_progress(progress)
        if progress.phase not in ("reading", "saving"):
            self._interruption.state = (
                f"{_LEFT.get(progress.phase, 'the board holds an unfinished import')}, stopped while "
                f"{PHASES[progress.phase]}, at {escape(progress.item)} ({progress.done} of {progress.total}); "
                f"{self._ways}"
            )

    def _report(self, plan: Plan, applied: ApplyResult) -> None:
        self._interruption.state = "the import is finished"
        backup = applied.backup and str(applied.backup)
        if self._args.json:
            described = {"changed": applied.changed, "resumed": applied.resumed, "backup": backup}
            print_json({**described, "plan": plan_object(plan)})
            return
        print_text("done, and verified by reading the whole board twice", "green")
        if backup and not (applied.resumed and self._args.command == "rollback"):
            begun = " the unfinished import" if applied.resumed else ""
            print_text(f"what was there before{begun} is in {backup}; `servolink rollback` brings it back")


_LEFT: dict[Phase, str] = {
    "marking": "the board may say that it holds an unfinished import, but nothing else was changed",
    "finishing": "everything is written, but the board may still say that the import is unfinished",
}


def _done(plan: Plan) -> object:
    """Return what is done, without what it takes."""
    return plan.changes, plan.inconsistencies, plan.is_unfinished
