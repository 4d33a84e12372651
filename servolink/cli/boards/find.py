"""`servolink list`, `use` and `info`: connected boards, names of boards, and the report of a board."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable, Sequence
from itertools import zip_longest
from typing import TypeVar

from msgspec import UNSET, UnsetType
from msgspec.structs import asdict

from servolink.boards import NO_BOARD_FOUND, Alias, Aliases, ProfileFile, discover, search
from servolink.cli.arguments import timeout
from servolink.cli.boards.board_settings import MemoryShown, battery_text, memory_text
from servolink.cli.command import FIRST_STEPS, STORED, Command, flag, one_of, option
from servolink.cli.command_session import (
    KEEP_MODE,
    Interruption,
    agreed,
    interruptible,
    on_board,
    refuse_unasked,
)
from servolink.cli.screen.output import Table, print_error, table_of
from servolink.cli.screen.result import CommandResult, Ending, Remark, Returned
from servolink.cli.usage import usage_error
from servolink.client import Board
from servolink.connection import options_in
from servolink.doctor import ProbeResponse, probe
from servolink.errors import InvalidAddress, RequestTimeout, ServolinkError, TransportError, quote
from servolink.protocol import ALL_SERVOS
from servolink.support import ALL, ExitCode, is_name
from servolink.transports import Address, DeviceInfo, create

T = TypeVar("T")


class ListedBoard(DeviceInfo, frozen=True, kw_only=True):
    """Possible board; `response` is left out without --probe, and null without a response."""

    name: str | None
    response: ProbeResponse | UnsetType | None = UNSET


class ListedBoards(CommandResult, frozen=True):
    """JSON of `list`: all possible boards."""

    boards: list[ListedBoard]


class BoardName(CommandResult, frozen=True):
    """JSON of `use`: the name and its meaning."""

    name: str
    url: str
    serial_number: str


class BoardNames(CommandResult, frozen=True):
    """JSON of `use` with --list: all names, sorted."""

    names: list[BoardName]


class NameRemoved(CommandResult, frozen=True):
    """JSON of `use` with --remove: the name that was forgotten."""

    removed: str


class BoardInfo(CommandResult, frozen=True, kw_only=True):
    """JSON of `info`; null for each fact whose query is `unanswered`."""

    url: str
    project_id: int | None
    has_unfinished_import: bool
    memory: MemoryShown
    battery_percent: float | None
    servos: int | None
    actions: int | None
    macros: int | None
    joystick_tables: int | None
    transmission_mode: dict[str, int | None]
    active_joystick_table: int | None
    angle_unit: str | None
    round_trip_seconds: float | None
    unanswered: list[str]


@Command(
    "list",
    FIRST_STEPS,
    help="list the boards that are connected to this computer",
    examples=("list", "list --probe"),
    options=(
        flag("--probe", "open each and ask whether it is a board"),
        timeout("with --probe: how long to wait for each response, 1 unless given"),
    ),
    takes_board=False,
)
@interruptible("nothing was changed")
async def run_list(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Return everything that may be a board; only --probe opens anything."""
    devices = await discover()
    names = _aliases().by_url(devices)
    probes = [probe(device.url, args.timeout) for device in devices] if args.probe else []
    responses = await asyncio.gather(*probes)
    found = [
        ListedBoard(
            **{**asdict(device), "problem": device.problem if result is None else result.problem},
            name=names.get(device.url),
            response=UNSET if result is None else result.response,
        )
        for device, result in zip_longest(devices, responses)
    ]
    if not devices:
        return Returned(ListedBoards(found), Remark(NO_BOARD_FOUND), ExitCode.NO_BOARD)
    return Returned(ListedBoards(found), _table(found))


def _aliases() -> Aliases:
    """Return the names of boards; if their file is broken, print why and return none: the boards are there anyway."""
    try:
        return Aliases.load()
    except TransportError as error:
        print_error(f"servolink: {error}")
        return Aliases()


def _table(found: Sequence[ListedBoard]) -> Table:
    """Return a row for each device, without empty columns."""
    columns = {
        "address": [one.url for one in found],
        "name": [one.name or "" for one in found],
        "product": [": ".join(filter(None, (one.product, one.shares))) for one in found],
        "serial number": [one.serial_number for one in found],
        "response": [_response(one) for one in found],
        "problem": [one.problem for one in found],
    }
    return table_of(columns)


def _project(project_id: int | None) -> str:
    """Return a project id as text, also of a board that has none or does not tell it."""
    return "unknown" if project_id is None else str(project_id or "none")


def _response(found: ListedBoard) -> str:
    """Return the response of a probed board as text for a table, empty for one that was not probed."""
    if found.response is None or isinstance(found.response, UnsetType):
        return "" if found.problem or found.response is UNSET else "none"
    mode = "" if found.response.transmission_mode == 1 else ", was in the old transmission mode"
    return f"{found.response.byte_order} endian, project {_project(found.response.project_id)}{mode}"


@Command(
    "use",
    FIRST_STEPS,
    help="give a board a name, for --board and for programs",
    examples=("use left-arm virtual://", "use --list", "use --remove left-arm"),
    options=(
        option("name", "NAME", "of letters, digits, - and _", nargs="?"),
        option("address", "BOARD", "the address, as `servolink list` prints it", nargs="?"),
        flag("--yes", "give the name of another board without asking"),
        one_of(flag("--list", "print all names"), option("--remove", "NAME", "forget a name")),
    ),
    takes_board=False,
)
def run_use(args: argparse.Namespace) -> Ending:
    """Keep, print or forget names; nothing is opened."""
    given = [args.name, args.address].count(None)
    if args.list or args.remove is not None:
        if given != 2:
            usage_error(args, "--list and --remove take no address")
        return _list_names() if args.list else _forget_name(args)
    if given:
        usage_error(args, "give a name and an address, or --list, or --remove NAME")
    return _keep_name(args)


@interruptible("nothing was changed")
async def _keep_name(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Save a name for an address, after asking about a changed meaning."""
    if not is_name(args.name):
        usage_error(args, f"{quote(args.name)} cannot be a name: use up to 64 letters, digits, - and _, and no port")
    if args.name == ALL:
        usage_error(args, f"{ALL!r} means every board of a fleet: choose another name")
    url = Address.parse(args.address).with_options(_options(args))
    alias = Alias.at(url, search())
    _refuse_invalid(url)
    before = Aliases.load().get(args.name)
    if before is None or before == alias or args.yes:
        return _save(args, alias)
    question = f"{args.name} is {_meant(before)} now"
    if args.name in ProfileFile.names() and not before.is_at(alias.url):
        question += f", which would lose its limits to {_meant(alias)}: see `servolink board show {args.name}`"
    refuse_unasked(args, f"{question}; --yes gives the name to {alias.url}")
    is_agreed = await agreed(args, interruption, f"{question}. Give the name to {alias.url}?")
    return _save(args, alias) if is_agreed else ExitCode.FAILED


def _options(args: argparse.Namespace) -> dict[str, str]:
    """Return the options of the connection on the command line, as an address has them."""
    patience = None if args.timeout is None else f"{args.timeout:g}"
    given = {"byte_order": args.byte_order, "caption_encoding": args.caption_encoding, "patience": patience}
    return {name: value for name, value in given.items() if value is not None}


def _save(args: argparse.Namespace, alias: Alias) -> Returned:
    Aliases.save(args.name, alias)
    kept = BoardName(args.name, alias.url, alias.serial_number)
    return Returned(kept, f"{args.name} is {_meant(alias)}; kept in {Aliases.path()}")


def _meant(alias: Alias) -> str:
    """Return the meaning of a name: a serial number or an address."""
    number = alias.serial_number
    return f"the board with serial number {number}, on any port" if number else alias.url


def _refuse_invalid(url: str) -> None:
    """Raise InvalidAddress if `url` is written wrongly. What only cannot be used at the moment can have a name."""
    options_in(url)
    try:
        create(url)
    except InvalidAddress:
        raise
    except TransportError:
        pass


def _list_names() -> Returned:
    """Return all names of boards, with addresses and serial numbers."""
    names = [BoardName(name, alias.url, alias.serial_number) for name, alias in sorted(Aliases.load().items())]
    rows = [(one.name, one.url, one.serial_number or None) for one in names]
    none = "no board has a name; `servolink use NAME BOARD` gives one"
    return Returned(BoardNames(names), Table(("name", "address", "serial number"), rows) if rows else none)


def _forget_name(args: argparse.Namespace) -> Returned:
    """Remove a name. Raise ServolinkError for an unknown name."""
    aliases = Aliases.load()
    if args.remove not in aliases:
        known = ", ".join(sorted(aliases)) or "none"
        raise ServolinkError(f"no board is named {quote(args.remove)} (names: {known}); nothing was changed")
    Aliases.remove(args.remove)
    text = [f"{args.remove} is forgotten"]
    if args.remove in ProfileFile.names():
        text.append(f"what was learnt of it is kept; to forget that too: servolink board forget {args.remove}")
    return Returned(NameRemoved(args.remove), text)


@Command(
    "info",
    STORED,
    help="show project id, memory, battery and what is stored on the board",
    examples=("info", "info --json", "info --timeout 10"),
    options=(KEEP_MODE,),
)
@on_board()
async def run_info(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Ask for everything."""
    missing = set(board.unanswered)

    async def ask(query: str, asking: Callable[[], Awaitable[T]]) -> T | None:
        if query not in missing:
            try:
                return await asking()
            except RequestTimeout:
                missing.add(query)
        return None

    def count(found: Sequence[object] | None) -> int | None:
        return None if found is None else len(found)

    memory = await ask("QueryMemorySize", board.memory)
    charge = await ask("QueryRemainPower", board.battery)
    known = BoardInfo(
        url=board.url,
        project_id=await ask("QueryProjectID", board.project_id),
        has_unfinished_import=await board.has_unfinished_import(),
        memory=MemoryShown(*((memory.size, memory.total_size) if memory else (None, None))),
        battery_percent=charge,
        servos=count(await ask("QueryServoList", board.servo_ids)),
        actions=count(await ask("QueryActionList", board.actions)),
        macros=count(await ask("QueryMacroList", board.macros)),
        joystick_tables=count(await ask("QueryJoystickTableList", board.joystick_tables)),
        transmission_mode={"found": _mode_found(board), "set": board.connection.opener.mode_answered},
        active_joystick_table=await ask("QueryActiveJoystickTable", board.active_joystick_table),
        angle_unit=board.unit_of(ALL_SERVOS),
        round_trip_seconds=board.stats.round_trip(50),
        unanswered=sorted(missing),
    )
    if missing:
        print_error(f"left out, as the board does not answer: {', '.join(sorted(missing))}")
    battery = None if "QueryRemainPower" in missing else battery_text(charge)
    mode = _mode_text(_mode_found(board), kept=args.keep_mode)
    return Returned(known, _facts(known, None if memory is None else memory_text(board, memory), battery, mode))


def _mode_found(board: Board) -> int | None:
    """Return the transmission mode before this command; None if the board was not asked before mode 1 was set."""
    opener = board.connection.opener
    if opener.woke:
        return 0
    return 1 if opener.mode_answered is None else None


def _mode_text(found: int | None, *, kept: bool) -> str:
    if found is None:
        return "1, set at each opening"
    if found:
        return "1"
    return "0, and 1 during this command" if kept else "1, set by this command; 0 before"


def _facts(known: BoardInfo, memory: str | None, battery: str | None, mode: str) -> Table:
    """Return the table of `servolink info`, a row for each fact that the board reports."""
    active, tables, round_trip = known.active_joystick_table, known.joystick_tables, known.round_trip_seconds
    shown_id = "none: an import is unfinished" if known.has_unfinished_import else known.project_id or "none"
    rows: list[tuple[str, object]] = [
        ("board", known.url),
        ("project id", None if known.project_id is None else shown_id),
        ("memory", memory),
        ("battery", battery),
        ("servos", known.servos),
        ("actions", known.actions),
        ("macros", known.macros),
        ("joystick tables", None if tables is None else f"{tables}, active: {'none' if active is None else active}"),
        ("transmission mode", mode),
        ("angle unit", f"{known.angle_unit}, which servolink sets before it reads or moves servos"),
        ("round trip", "unknown" if round_trip is None else f"{round_trip * 1000:.1f} ms"),
    ]
    return Table((), [row for row in rows if row[1] is not None])
