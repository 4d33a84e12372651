"""`servolink list`, `use` and `info`: connected boards, names of boards, and the report of a board."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import zip_longest
from typing import TypeVar

import msgspec

from servolink.cli.arguments import timeout
from servolink.cli.boards.board_settings import battery_text, memory_text
from servolink.cli.command import FIRST_STEPS, STORED, Command, flag, one_of, option
from servolink.cli.command_session import (
    KEEP_MODE,
    Interruption,
    agreed,
    interruptible,
    on_board,
    refuse_unasked,
    run_interruptible,
)
from servolink.cli.screen.output import Table, print_error, print_json, print_result, print_table, print_text, table_of
from servolink.cli.usage import usage_error
from servolink.client.board import Board
from servolink.connection.options import options_in
from servolink.discovery.names import (
    Alias,
    alias_for,
    aliases_path,
    load_aliases,
    names_by_url,
    remove_alias,
    save_alias,
)
from servolink.discovery.search import NO_BOARD_FOUND, discover, is_same_place, search
from servolink.doctor.contact import PATIENCE, ProbeResult, probe
from servolink.errors import InvalidAddress, OpenError, Reason, RequestTimeout, ServolinkError, TransportError
from servolink.escaping import quote
from servolink.files import ALL, is_name
from servolink.profiles.listing import profile_names
from servolink.protocol.servos import ALL_SERVOS
from servolink.script import FAILED, NO_BOARD, OK
from servolink.transports.address import with_options
from servolink.transports.device_info import DeviceInfo
from servolink.transports.registry import create

T = TypeVar("T")


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
async def run_list(args: argparse.Namespace, interruption: Interruption) -> int:
    """Print everything that may be a board; only --probe opens anything."""
    devices = await discover()
    names = names_by_url(_aliases(), devices)
    probes = [probe(device.url, args.timeout or PATIENCE) for device in devices] if args.probe else []
    responses = await asyncio.gather(*probes)
    if args.json:
        described = [msgspec.to_builtins(device) | {"name": names.get(device.url)} for device in devices]
        for one, result in zip(described, responses, strict=False):
            one |= {"response": result.response and asdict(result.response), "problem": result.problem}
        print_json({"boards": described})
    elif devices:
        print_table(_table(devices, names, responses))
    if devices:
        return OK
    if args.json:
        return NO_BOARD
    raise OpenError(NO_BOARD_FOUND, reason=Reason.NOT_FOUND)


def _aliases() -> dict[str, Alias]:
    """Return the names of boards; if their file is broken, print why and return none: the boards are there anyway."""
    try:
        return load_aliases()
    except TransportError as error:
        print_error(f"servolink: {error}")
        return {}


def _table(devices: Sequence[DeviceInfo], names: Mapping[str, str], responses: Sequence[ProbeResult]) -> Table:
    """Return a row for each device, without empty columns."""
    columns = {
        "address": [device.url for device in devices],
        "name": [names.get(device.url, "") for device in devices],
        "product": [": ".join(filter(None, (device.product, device.shares))) for device in devices],
        "serial number": [device.serial_number for device in devices],
        "response": [_response(result) for result in responses] or [""] * len(devices),
        "problem": [
            device.problem if result is None else result.problem for device, result in zip_longest(devices, responses)
        ],
    }
    return table_of(columns)


def _project(project_id: int | None) -> str:
    """Return a project id as text, also of a board that has none or does not tell it."""
    return "unknown" if project_id is None else str(project_id or "none")


def _response(result: ProbeResult) -> str:
    """Return the response of a probed board as text for a table."""
    if result.response is None:
        return "" if result.problem else "none"
    mode = "" if result.response.transmission_mode == 1 else ", was in the old transmission mode"
    return f"{result.response.byte_order} endian, project {_project(result.response.project_id)}{mode}"


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
def run_use(args: argparse.Namespace) -> int:
    """Keep, print or forget names; nothing is opened."""
    given = [args.name, args.address].count(None)
    if args.list or args.remove is not None:
        if given != 2:
            usage_error(args, "--list and --remove take no address")
        return _list_names(args) if args.list else _forget_name(args)
    if given:
        usage_error(args, "give a name and an address, or --list, or --remove NAME")
    return _keep_name(args)


def _keep_name(args: argparse.Namespace) -> int:
    """Save a name for an address, after asking about a changed meaning."""
    if not is_name(args.name):
        usage_error(args, f"{quote(args.name)} cannot be a name: use up to 64 letters, digits, - and _, and no port")
    if args.name == ALL:
        usage_error(args, f"{ALL!r} means every board of a fleet: choose another name")
    url = with_options(args.address, _options(args))
    alias = alias_for(url, search())
    _refuse_invalid(url)
    before = load_aliases().get(args.name)
    if before is None or before == alias or args.yes:
        return _save(args, alias)
    question = f"{args.name} is {_meant(before)} now"
    if args.name in profile_names() and not is_same_place(before.url, alias.url):
        question += f", which would lose its limits to {_meant(alias)}: see `servolink board show {args.name}`"
    refuse_unasked(args, f"{question}; --yes gives the name to {alias.url}")

    async def main(interruption: Interruption) -> int:
        is_agreed = await agreed(args, interruption, f"{question}. Give the name to {alias.url}?")
        return _save(args, alias) if is_agreed else FAILED

    return run_interruptible(main, "nothing was changed")


def _options(args: argparse.Namespace) -> dict[str, str]:
    """Return the options of the connection on the command line, as an address has them."""
    patience = None if args.timeout is None else f"{args.timeout:g}"
    given = {"byte_order": args.byte_order, "caption_encoding": args.caption_encoding, "patience": patience}
    return {name: value for name, value in given.items() if value is not None}


def _save(args: argparse.Namespace, alias: Alias) -> int:
    save_alias(args.name, alias)
    print_result(args, _named(args.name, alias), f"{args.name} is {_meant(alias)}; kept in {aliases_path()}")
    return OK


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


def _list_names(args: argparse.Namespace) -> int:
    """Print all names of boards, with addresses and serial numbers."""
    aliases = sorted(load_aliases().items())
    if args.json:
        print_json({"names": [_named(name, alias) for name, alias in aliases]})
    elif aliases:
        print_table(
            Table(("name", "address", "serial number"), [(n, a.url, a.serial_number or None) for n, a in aliases])
        )
    else:
        print_text("no board has a name; `servolink use NAME BOARD` gives one")
    return OK


def _forget_name(args: argparse.Namespace) -> int:
    """Remove a name. Raise ServolinkError for an unknown name."""
    aliases = load_aliases()
    if args.remove not in aliases:
        known = ", ".join(sorted(aliases)) or "none"
        raise ServolinkError(f"no board is named {quote(args.remove)} (names: {known}); nothing was changed")
    remove_alias(args.remove)
    if args.json:
        print_json({"removed": args.remove})
    else:
        print_text(f"{args.remove} is forgotten")
        if args.remove in profile_names():
            print_text(f"what was learnt of it is kept; to forget that too: servolink board forget {args.remove}")
    return OK


def _named(name: str, alias: Alias) -> dict[str, str]:
    return {"name": name, "url": alias.url, "serial_number": alias.serial_number}


@Command(
    "info",
    STORED,
    help="show project id, memory, battery and what is stored on the board",
    examples=("info", "info --json", "info --timeout 10"),
    options=(KEEP_MODE,),
)
@on_board()
async def run_info(args: argparse.Namespace, board: Board, interruption: Interruption) -> int:
    """Ask for everything and print it."""
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
    described: dict[str, object] = {
        "url": board.url,
        "project_id": await ask("QueryProjectID", board.project_id),
        "has_unfinished_import": await board.has_unfinished_import(),
        "memory": {"size_bytes": memory and memory.size, "total_size_bytes": memory and memory.total_size},
        "battery_percent": charge,
        "servos": count(await ask("QueryServoList", board.servo_ids)),
        "actions": count(await ask("QueryActionList", board.actions)),
        "macros": count(await ask("QueryMacroList", board.macros)),
        "joystick_tables": count(await ask("QueryJoystickTableList", board.joystick_tables)),
        "transmission_mode": {"found": _mode_found(board), "set": board.connection.opener.mode_answered},
        "active_joystick_table": await ask("QueryActiveJoystickTable", board.active_joystick_table),
        "angle_unit": board.unit_of(ALL_SERVOS),
        "round_trip_seconds": board.stats.round_trip(50),
    }
    described["unanswered"] = sorted(missing)
    if missing:
        print_error(f"left out, as the board does not answer: {', '.join(sorted(missing))}")
    if args.json:
        print_json(described)
    else:
        battery = None if "QueryRemainPower" in missing else battery_text(charge)
        mode = _mode_text(_mode_found(board), kept=args.keep_mode)
        print_table(_facts(described, None if memory is None else memory_text(board, memory), battery, mode))
    return OK


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


def _facts(described: dict[str, object], memory: str | None, battery: str | None, mode: str) -> Table:
    """Return the table of `servolink info`, a row for each fact that the board reports."""
    active, round_trip = described["active_joystick_table"], described["round_trip_seconds"]
    project_id, tables = described["project_id"], described["joystick_tables"]
    shown_id = "none: an import is unfinished" if described["has_unfinished_import"] else project_id or "none"
    rows: list[tuple[str, object]] = [
        ("board", described["url"]),
        ("project id", None if project_id is None else shown_id),
        ("memory", memory),
        ("battery", battery),
        ("servos", described["servos"]),
        ("actions", described["actions"]),
        ("macros", described["macros"]),
        ("joystick tables", None if tables is None else f"{tables}, active: {'none' if active is None else active}"),
        ("transmission mode", mode),
        ("angle unit", f"{described['angle_unit']}, which servolink sets before it reads or moves servos"),
        ("round trip", f"{round_trip * 1000:.1f} ms" if isinstance(round_trip, float) else "unknown"),
    ]
    return Table((), [row for row in rows if row[1] is not None])
