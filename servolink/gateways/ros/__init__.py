"""ROS 2: joint states, trajectories, stop and diagnostics of a robot, as one more program of a hub."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.gateways.ros.ros_node import serve_ros as serve_ros
else:
    _MODULES = {"ros_node": ("serve_ros",)}
    __all__ = ["serve_ros"]
    __getattr__ = lazy_names(__name__, _MODULES, extra="ros2")
