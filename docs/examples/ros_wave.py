"""Print where the joints of `servolink ros2` are, and turn the first one there and back."""

# pyright: reportMissingImports=false

import math

import rclpy
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

POSES = {1: 20, 2: 0}
"""Angles in degrees by the seconds at which the joint is there."""


def main() -> None:
    """Send one trajectory, and watch until it has ended; the motion would end with this program."""
    rclpy.init()
    node = rclpy.create_node("wave")
    states: list[JointState] = []
    node.create_subscription(JointState, "joint_states", states.append, 10)
    publisher = node.create_publisher(JointTrajectory, "joint_trajectory", 1)
    while not states or not publisher.get_subscription_count():
        rclpy.spin_once(node)
    joint = states[-1].name[0]
    wave = JointTrajectory(joint_names=[joint])
    for seconds, degrees in POSES.items():
        at = Duration(sec=seconds)
        wave.points.append(JointTrajectoryPoint(positions=[math.radians(degrees)], time_from_start=at))
    publisher.publish(wave)
    for degrees in POSES.values():
        while abs(states[-1].position[0] - math.radians(degrees)) > math.radians(1):
            rclpy.spin_once(node)
        print(f"{joint} is at {degrees} degrees")
    rclpy.shutdown()


main()
