"""`add`, `set`, `rename` and `delete` of `servolink action`, `macro` and `table`, and `servolink table activate`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from servolink.cli.apply import refuse_without_answer
from servolink.cli.arguments import RECORD_ID, RECORD_NAME
from servolink.cli.main import OK, usage_error
from servolink.cli.output import print_json, print_text
from servolink.cli.session import Interruption, run_with_board
from servolink.cli.stored.change import UNTOUCHED, change_board
from servolink.cli.stored.given import (
    add_action_options,
    add_macro_options,
    add_table_options,
    empty,
    maker,
    with_servo_ids,
)
from servolink.cli.stored.show import kind_of
from servolink.client.board import Board
from servolink.errors import AmbiguousName, NotFound, ProjectError
from servolink.escaping import quote
from servolink.project.model import Project
from servolink.project.naming import Named, captioned, closest, id_or_caption, listed
from servolink.project.project_file import load_project
from servolink.project.records import find, name_of, with_caption, with_id
from servolink.project.single_record import add_from, add_record, remove_records, replace_from, replace_record
from servolink.protocol.record_types import RecordType

_JSON = "a record as JSON, which begins with {, or @FILE or - (standard input) with it"


def _add_add(parser: argparse.ArgumentParser, add_options: Callable[[argparse.ArgumentParser], None]) -> None:
    parser.set_defaults(run=run_add, yes=True)
    parser.add_argument("what", metavar="CAPTION", help=f"its caption, at most 32 bytes; or {_JSON}")
    add_options(parser)
    parser.add_argument("--id", type=RECORD_ID, metavar="ID", help="its id (the lowest free one)")
    _add_source(parser, "the record CAPTION of this project file, with all that it runs")


def _add_set(parser: argparse.ArgumentParser, add_options: Callable[[argparse.ArgumentParser], None]) -> None:
    parser.set_defaults(run=run_set, yes=True)
    _add_id(parser)
    parser.add_argument("what", nargs="?", metavar="RECORD", help=f"{_JSON}; what it leaves out stays")
    add_options(parser)
    _add_source(parser, "the record RECORD, by caption or id, of this project file")


def _add_source(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE", help=f"take {what}")


def _add_id(parser: argparse.ArgumentParser, **options: Any) -> None:
    parser.add_argument("record", type=RECORD_NAME, metavar="NAME", help="its caption or id, as in the list", **options)


def configure_add_action(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink action add`."""
    _add_add(parser, add_action_options)


def configure_add_macro(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink macro add`."""
    _add_add(parser, add_macro_options)


def configure_add_table(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table add`."""
    _add_add(parser, add_table_options)


def configure_set_action(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink action set`."""
    _add_set(parser, add_action_options)


def configure_set_macro(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink macro set`."""
    _add_set(parser, add_macro_options)


def configure_set_table(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table set`."""
    _add_set(parser, add_table_options)


def configure_rename(parser: argparse.ArgumentParser) -> None:
    """Add the options of `rename`."""
    parser.set_defaults(run=run_rename, yes=True)
    _add_id(parser)
    parser.add_argument("caption", metavar="CAPTION", help="the new caption, at most 32 bytes")


def configure_delete(parser: argparse.ArgumentParser) -> None:
    """Add the options of `delete`."""
    parser.set_defaults(run=run_delete)
    _add_id(parser, nargs="+")
    parser.add_argument("--yes", action="store_true", help="do not ask")


def configure_activate(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink table activate`."""
    parser.set_defaults(run=run_activate)
    _add_id(parser)


def run_add(args: argparse.Namespace) -> int:
    """Store a record that is not there yet."""
    kind = kind_of(args)
    if args.source is not None:
        if args.id is not None:
            usage_error(args, "--id and --from are both given; the record keeps the id of the file if it is free")
        source, record = _from_file(args, kind)
        return change_board(
            args, lambda project, encoding: add_from(project, source, record, caption_encoding=encoding)
        )
    make = maker(args, kind)
    caption = "" if args.what.startswith(("{", "@")) or args.what == "-" else args.what
    record = make(empty(kind, caption, 0))
    if args.id is not None:
        record = with_id(record, args.id)

    def edit(project: Project, encoding: str) -> Project:
        return add_record(project, with_servo_ids(project, record), caption_encoding=encoding)

    return change_board(args, edit)


def run_set(args: argparse.Namespace) -> int:
    """Change a record that is there."""
    kind = kind_of(args)
    if args.source is not None:
        return _set_from_file(args, kind)
    make = maker(args, kind)

    def edit(project: Project, encoding: str) -> Project:
        old = _stored(project, kind, args.record)
        record = with_servo_ids(project, make(old))
        if kind.id_of(record) != kind.id_of(old):
            raise ProjectError(
                f"the JSON has the id {kind.id_of(record)}, not {kind.id_of(old)}; leave it out; {UNTOUCHED}"
            )
        return replace_record(project, record, caption_encoding=encoding)

    return change_board(args, edit)


def _set_from_file(args: argparse.Namespace, kind: RecordType[Any]) -> int:
    if args.what is None:
        usage_error(args, "say which record of the file: its caption or its id")
    source, record = _from_file(args, kind)

    def edit(project: Project, encoding: str) -> Project:
        record_id = kind.id_of(_stored(project, kind, args.record))
        return replace_from(project, source, record, record_id, caption_encoding=encoding)

    return change_board(args, edit)


def _from_file(args: argparse.Namespace, kind: RecordType[Any]) -> tuple[Project, Any]:
    """Return the project file of `args` and the record that it names. ProjectError if there is none."""
    if any(getattr(args, name, None) is not None for name in ("pose", "seconds", "play", "press", "long_press", "up")):
        usage_error(args, f"{args.needed} and --from are both given; choose one")
    source = load_project(args.source, unchecked=True)
    return source, find(source, args.what, (kind,))


def run_rename(args: argparse.Namespace) -> int:
    """Give a record another caption."""
    kind = kind_of(args)

    def edit(project: Project, encoding: str) -> Project:
        record = with_caption(_stored(project, kind, args.record), args.caption)
        return replace_record(project, record, caption_encoding=encoding)

    return change_board(args, edit)


def run_delete(args: argparse.Namespace) -> int:
    """Delete records, after asking."""
    refuse_without_answer(args)
    kind = kind_of(args)

    def edit(project: Project, encoding: str) -> Project:
        return remove_records(project, kind, {kind.id_of(_stored(project, kind, name)) for name in args.record})

    return change_board(args, edit)


def _stored(project: Project, kind: RecordType[Any], name: int | str) -> Any:
    """Return a record of the board by id or caption. Raise NotFound, naming those that are there, if it has none."""
    records = kind.by_id(project)
    named = [Named(kind.label, number, kind.caption_of(record)) for number, record in records.items()]
    meant = id_or_caption(name) if isinstance(name, str) else name
    found = captioned(named, meant) if isinstance(meant, str) else [one for one in named if one.record_id == meant]
    if len(found) == 1:
        return records[found[0].record_id]
    if found:
        raise AmbiguousName(f"{quote(meant)} may be {listed(found, 'or')}; give the id; {UNTOUCHED}")
    there = closest(named, meant if isinstance(meant, str) else "")
    raise NotFound(f"the board has no {kind} {quote(meant)}; {UNTOUCHED}; {there}")


def run_activate(args: argparse.Namespace) -> int:
    """Make a joystick table the active one, and read it back."""

    async def talk(board: Board, interruption: Interruption) -> int:
        table = await board.joystick_table(args.record)
        interruption.state = f"{name_of(table)} may be active"
        await board.set_active_joystick_table(table.table_id)
        active = await board.active_joystick_table()
        interruption.state = f"joystick table {active or 'none'} is active"
        if active != table.table_id:
            raise ProjectError(f"{board.url} accepted {name_of(table)}, but reports {active or 'none'} as active")
        if args.json:
            print_json({"active_joystick_table": active})
        else:
            print_text(f"{name_of(table)} is active")
        return OK

    return run_with_board(args, talk, state=UNTOUCHED)
