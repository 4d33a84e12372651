"""`servolink info`: what a board is and what it holds."""

from __future__ import annotations

import argparse

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table
from servolink.cli.session import Interruption, converse
from servolink.client.board import Board
from servolink.protocol.servos import ALL_SERVOS


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add nothing: `servolink info` has no options of its own."""


def run(args: argparse.Namespace) -> int:
    """Ask for everything and print it."""

    async def talk(board: Board, interruption: Interruption) -> int:
        memory = await board.memory()
        described = {
            "url": board.url,
            "project_id": await board.project_id(),
            "has_unfinished_import": await board.has_unfinished_import(),
            "memory": {"size_bytes": memory.size, "total_size_bytes": memory.total_size},
            "battery_percent": await board.battery(),
            "servos": len(await board.servo_ids()),
            "actions": len(await board.actions()),
            "macros": len(await board.macros()),
            "joystick_tables": len(await board.joystick_tables()),
            "active_joystick_table": await board.active_joystick_table(),
            "angle_unit": board.unit_of(ALL_SERVOS),
            "round_trip_seconds": board.stats.round_trip(50),
        }
        if args.json:
            print_json(described)
        else:
            print_table(_facts(described, memory.size, memory.total_size))
        return OK

    return converse(args, talk)


def _facts(described: dict[str, object], free: int, total: int | None) -> Table:
    active, round_trip = described["active_joystick_table"], described["round_trip_seconds"]
    project_id = described["project_id"] or "none"
    if described["has_unfinished_import"]:
        project_id = "none: an import is unfinished"
    return Table(
        (),
        [
            ("board", described["url"]),
            ("project id", project_id),
            ("memory", f"{free:,} bytes free" + ("" if total is None else f" of {total:,}")),
            ("battery", f"{described['battery_percent']} %"),
            ("servos", described["servos"]),
            ("actions", described["actions"]),
            ("macros", described["macros"]),
            ("joystick tables", f"{described['joystick_tables']}, active: {'none' if active is None else active}"),
            ("angle unit", f"{described['angle_unit']}, which servolink sets before it reads or moves servos"),
            ("round trip", f"{round_trip * 1000:.1f} ms" if isinstance(round_trip, float) else "unknown"),
        ],
    )
