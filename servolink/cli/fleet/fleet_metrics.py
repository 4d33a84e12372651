"""`servolink fleet metrics`: the state of all boards for Prometheus."""

from __future__ import annotations

import argparse
import asyncio
from functools import partial

from servolink.cli.arguments import alarm, listening
from servolink.cli.command import Command, option
from servolink.cli.command_session import ENDLESS, Interruption, run_interruptible
from servolink.cli.fleet.broker_options import BROKER, fleet_of
from servolink.cli.screen.output import print_error, print_result
from servolink.cli.usage import needing_extra
from servolink.script import OK


@Command(
    "fleet metrics",
    help="serve the state of all boards to Prometheus",
    details=f"Only reads, in the format of OpenMetrics. {ENDLESS}",
    examples=("fleet metrics", "fleet metrics --alarm 'temperature_raw>300'"),
    options=(
        option(
            "--listen",
            "HOST:PORT",
            "where to serve; port 0 takes a free one (127.0.0.1:9464)",
            listening,
            default="127.0.0.1:9464",
        ),
        option(
            "--alarm",
            "RULE",
            "count the servos for which this holds, as in 'temperature_raw>300'; may be repeated",
            alarm,
            action="append",
            default=[],
        ),
        *BROKER,
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    return run_interruptible(partial(_serve, args), "nothing was changed")


async def _serve(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until the task is cancelled."""
    fleet = fleet_of(args, servos=True)
    with needing_extra("metrics"):
        from servolink.fleet.metrics import serve_metrics
    from servolink.client.alarms import Alarm
    from servolink.listeners.tcp import host_and_port, joined, reached_by

    host, port = host_and_port(args.listen)
    async with fleet:
        await fleet.list()
        with serve_metrics(fleet.controller, host, port, [Alarm.parse(text) for text in args.alarm]) as found:
            interruption.code = OK
            url = f"http://{joined(host, found)}/metrics"
            print_result(args, {"metrics": url}, f"metrics {url}")
            reached = reached_by(f"tcp://{joined(host, found)}")
            print_error(f"servolink: {url} can be read by {reached}")
            await asyncio.Event().wait()
    return OK
