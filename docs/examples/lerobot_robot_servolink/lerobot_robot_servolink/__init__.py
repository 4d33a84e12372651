"""Robots and leader arms on servolink's boards for LeRobot: the types `servolink` and `servolink_leader`."""

from .config_servolink import ServolinkConfig, ServolinkLeaderConfig
from .leader import ServolinkLeader
from .robot import Servolink

__all__ = ["Servolink", "ServolinkConfig", "ServolinkLeader", "ServolinkLeaderConfig"]
