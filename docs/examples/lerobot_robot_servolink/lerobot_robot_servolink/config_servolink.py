"""Settings of robots and leader arms, as on LeRobot's command line: `--robot.board=rex --robot.servos='[1, 2, 3]'`."""

from dataclasses import dataclass, field
from typing import Any

from lerobot.cameras import CameraConfig  # pyright: ignore[reportMissingImports]
from lerobot.robots import RobotConfig  # pyright: ignore[reportMissingImports]
from lerobot.teleoperators import TeleoperatorConfig  # pyright: ignore[reportMissingImports]

registered: Any = RobotConfig.register_subclass("servolink")
registered_leader: Any = TeleoperatorConfig.register_subclass("servolink_leader")


@registered
@dataclass(kw_only=True)
class ServolinkConfig(RobotConfig):  # type: ignore[misc,unused-ignore]
    """Robot: address or name of its board, and ids of the servos that LeRobot moves."""

    board: str
    servos: list[int]
    speed_cap: float = 180.0
    """Highest speed in degrees per second, beside the limits in the board's profile."""
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@registered_leader
@dataclass(kw_only=True)
class ServolinkLeaderConfig(TeleoperatorConfig):  # type: ignore[misc,unused-ignore]
    """Leader arm: its board, and ids of the servos, which are released and turned by hand."""

    board: str
    servos: list[int]
    follower: list[int] = field(default_factory=list)
    """Ids of the robot's servos in the same order, if they differ."""
    may_move: bool = False
    """Whether LeRobot may turn the arm to the robot's pose before a person takes over."""
    speed_cap: float = 90.0
    """Highest speed of that, in degrees per second, beside the limits in the profile of the arm's board."""
