"""`servolink ros2`: the robot as a node of ROS 2."""

from __future__ import annotations

import argparse
import asyncio

from servolink.cli.arguments import SPEED, file_path
from servolink.cli.command import TOGETHER, Command, flag, option
from servolink.cli.command_session import ENDLESS, Interruption, connection_options, interruptible
from servolink.cli.screen.result import show_served
from servolink.cli.together.language_models import SPEED_CAP, log_line
from servolink.hub import hub_of_board
from servolink.project import ProjectFile
from servolink.support import ExitCode


@Command(
    "ros2",
    TOGETHER,
    help="be a node of ROS 2: joint states, trajectories, stop",
    details="Publishes /joint_states, /robot_description and /diagnostics, follows /joint_trajectory, and stops by "
    f"/stop or /servolink/stop. Without ROS_AUTOMATIC_DISCOVERY_RANGE, only programs here see the node. {ENDLESS}",
    examples=("ros2", "ros2 --project robot.servolink.json --speed-cap 120"),
    options=(
        option("--project", "FILE", "a project file: names of the joints, and the figure", file_path),
        option("--speed-cap", "DEGREES", f"degrees per second, at most ({SPEED_CAP:g})", SPEED, default=SPEED_CAP),
        flag("--outlive", "follow a trajectory to its end though its sender is gone"),
    ),
)
@interruptible("nothing was sent to the board", in_usage=True)
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until Ctrl-C or SIGTERM, or until the hub has ended."""
    from servolink.gateways.ros import serve_ros

    project = None if args.project is None else await asyncio.to_thread(ProjectFile.read, args.project)
    async with hub_of_board(args.url, **connection_options(args)) as hub:
        interruption.state, interruption.code = "the content of the board was left unchanged", ExitCode.OK
        show_served(ros2="/servolink")
        await serve_ros(hub, project, args.speed_cap, log_line, outlive=args.outlive)
    return ExitCode.OK
