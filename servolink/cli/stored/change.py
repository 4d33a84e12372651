"""Change the content of a board by importing the same content with the change.

So it has the protection of an import: a backup, a mark on the board while it is under way, every record read back, and
a way back. No board loses a record by it, whatever it does with an id that is stored already.
"""

from __future__ import annotations

import argparse
from collections.abc import Awaitable, Callable, Iterator, Mapping
from typing import TypeAlias

from msgspec.structs import replace

from servolink.cli.command_session import UNFINISHED_IMPORT, UNTOUCHED, Interruption, run_with_board
from servolink.cli.motion.servo_output import warn_of_missing
from servolink.cli.projects.apply import BoardImport
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import Ending, Part
from servolink.cli.stored.record_tables import changes_text
from servolink.client import ALL, Board
from servolink.errors import ProjectError, quote
from servolink.project import (
    Change,
    Named,
    Plan,
    ProgressCallback,
    Project,
    compare,
    duplicates,
    id_or_caption,
    name_of,
    refuse_new_errors,
)
from servolink.protocol import SERVO_PARAMETER, STORED_TYPES, ServoParameter

Edit: TypeAlias = Callable[[Project, str], Project]
"""Function from the content of the board and the caption encoding to the new content."""

_WAY_OUT = "nothing is lost: `servolink rollback` undoes it"


def change_board(
    args: argparse.Namespace, edit: Edit, *, prepare: Callable[[Board], Awaitable[None]] | None = None
) -> int:
    """Connect, and write the content changed by `edit` to the board, after asking unless `args.yes`.

    `prepare` reads first what else `edit` has to know.
    """

    async def talk(board: Board, interruption: Interruption) -> Ending:
        if prepare is not None:
            await prepare(board)
        return await change_content(args, board, interruption, edit)

    return run_with_board(args, talk, greet=False, state=UNTOUCHED)


async def change_content(args: argparse.Namespace, board: Board, interruption: Interruption, edit: Edit) -> Ending:
    """Write the content changed by `edit` to the board.

    Raise ProjectError if it holds an unfinished import, or if another program changes it meanwhile.
    """
    if await board.has_unfinished_import():
        raise ProjectError(f"{UNFINISHED_IMPORT}; {UNTOUCHED}")
    with shown_progress(board) as on_progress:
        before = await board.export_project(on_progress=on_progress)
    after = edit(before, board.codec.caption_encoding)
    wanted = compare(before, after)
    for shared in newly_shared_captions(before, after):
        print_error(f"servolink: {shared}; from now on, give ids")
    for caption in _hidden_captions(before, after):
        print_error(f"servolink: in commands, the caption {quote(caption)} is written name:{caption}")
    for repeated in _repeated_servos(before, after):
        print_error(f"servolink: {repeated}; boards differ in the step used")
    await _warn_of_missing_servos(board, before, after)

    async def plan(on_progress: ProgressCallback) -> Plan:
        found = await board.plan_project(after, unchecked=True, on_progress=on_progress)
        if found.changes != wanted:
            raise ProjectError(f"{board.url}: another program is changing the board; {UNTOUCHED}; try again")
        return found

    return await BoardImport(args, board, interruption, _WAY_OUT, text=changed_text).run(
        plan, lambda show: board.apply_project(after, unchecked=True, on_progress=show)
    )


def _hidden_captions(before: Project, after: Project) -> Iterator[str]:
    """Yield each new caption that commands would misread: as an id, as all servos, or as `name:`."""
    for kind in STORED_TYPES:
        old, new = ({kind.caption_of(one) for one in kind.by_id(project).values()} for project in (before, after))
        for caption in sorted(new - old):
            if id_or_caption(caption) != caption or (kind is SERVO_PARAMETER and caption == ALL):
                yield caption


def _repeated_servos(before: Project, after: Project) -> Iterator[str]:
    """Yield each servo with several steps in a new action, as `action 5 'Wave' has several steps for servo 1`."""
    known = [action.steps for action in before.actions]
    for action in after.actions:
        if action.steps not in known:
            for servo_id in dict.fromkeys(action.steps[each.at].servo_id for each in duplicates(action.steps)):
                yield f"{name_of(action)} has several steps for servo {servo_id}"


async def _warn_of_missing_servos(board: Board, before: Project, after: Project) -> None:
    """Say which servos of new steps the board does not have."""
    known = [action.steps for action in before.actions]
    moved = {step.servo_id for action in after.actions if action.steps not in known for step in action.steps}
    if moved and (missing := moved - set(await board.servo_ids())):
        warn_of_missing(missing)


def newly_shared_captions(before: Project, after: Project) -> Iterator[str]:
    """Yield who shares each new caption, in a text such as `action 1 'Wave' and action 3 'Wave' share a caption`."""
    for kind in STORED_TYPES:
        old, new = (
            {Named(kind.label, number, kind.caption_of(one)) for number, one in kind.by_id(project).items()}
            for project in (before, after)
        )
        for caption in sorted({one.caption for one in new - old} - {""}):
            same = sorted(one for one in new if one.caption == caption)
            if len(same) > 1:
                yield f"{Named.listed(same)} share a caption"


def _renamed(change: Change) -> Change:
    """Return `change`; the first caption of a servo, without correction, becomes a change of the caption."""
    stored = change.new
    if change.old is not None or not isinstance(stored, ServoParameter) or stored.adjusted_degree:
        return change
    return Change(change.what, ServoParameter(stored.servo_id), stored)


def changed_text(plan: Plan) -> Iterator[Part]:
    """Yield the planned changes, without the costs."""
    yield from changes_text([_renamed(change) for change in plan.changes])
    if not plan.differs:
        yield "nothing to change: the board already matches"


async def change_parameters(
    args: argparse.Namespace,
    board: Board,
    interruption: Interruption,
    changes: Mapping[int, Callable[[ServoParameter], ServoParameter]],
) -> Ending:
    """Store servo parameters changed by `changes`, by servo id, after a backup, and read the result back."""

    def edit(project: Project, encoding: str) -> Project:
        stored = project.by_servo()
        for servo_id, change in changes.items():
            stored[servo_id] = change(stored.get(servo_id, ServoParameter(servo_id)))
        after = replace(project, servo_parameters=tuple(stored.values()))
        refuse_new_errors(project, after, encoding)
        return after

    return await change_content(args, board, interruption, edit)
