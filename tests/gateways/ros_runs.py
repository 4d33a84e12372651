"""`servolink ros2` with ROS 2 itself, in several processes on this machine: what is measured, and what must hold.

`python -m tests.gateways.ros_runs`, in an environment with the extra ros2 and what `ros_messages/build` adds, prints
the figures, and fails if one is out of bounds. `python -m tests.gateways.ros_runs mover SECONDS` is a program that is
ended after it has sent a trajectory; with `asker`, it has sent a goal of the action.
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration as Seconds
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import servolink.sync
from servolink import MotionRefused, Project, ServoParameter, save_project
from servolink.project import Figure, Joint, View
from tests import processes
from tests.gateways.lerobot_runs import shared

ARM = Figure(
    version=1,
    name="Arm",
    view=View(),
    joints=(
        Joint("base", length=40, along=(0, 1, 0), width=80),
        Joint("lower", "base", servo=1, at=(0, 40, 0), length=150, along=(0, 1, 0), limits=(-90, 90)),
        Joint("upper", "lower", servo=2, at=(0, 150, 0), length=120, along=(0, 1, 0), limits=(-90, 90)),
    ),
)
PATIENCE = 60.0
"""Seconds for what has no bound of its own, such as discovery."""
JOINT = "servo_1"
NAN = math.nan
FLOOD = 1000
"""Messages a second."""


def trajectory(*points: tuple[float, float], names: tuple[str, ...] = (JOINT,)) -> Any:
    """Return a trajectory of times and angles in degrees, each the angle of all joints."""
    message = JointTrajectory(joint_names=list(names))
    for seconds, degrees in points:
        at = Seconds(sec=int(seconds), nanosec=int(seconds % 1 * 1e9))
        message.points.append(JointTrajectoryPoint(positions=[math.radians(degrees)] * len(names), time_from_start=at))
    return message


class Client:
    """Program of ROS that sees and moves the robot."""

    def __init__(self) -> None:
        rclpy.init(args=[])
        self.node = rclpy.create_node("client")
        self.ages: list[float] = []
        self.track: list[tuple[float, float]] = []
        """Stamps, and angles of the joint in degrees."""
        self.diagnostics: dict[str, tuple[int, str]] = {}
        self.node.create_subscription(JointState, "joint_states", self._see, 10)
        self.node.create_subscription(DiagnosticArray, "diagnostics", self._read, 10)
        self.publisher = self.node.create_publisher(JointTrajectory, "joint_trajectory", 10)

        self.action = ActionClient(self.node, FollowJointTrajectory, "/servolink/follow_joint_trajectory")
        self.feedback: list[Any] = []

    def _see(self, message: Any) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
        self.ages.append(time.time() - stamp)
        self.track.append((stamp, math.degrees(message.position[message.name.index(JOINT)])))

    def _read(self, message: Any) -> None:
        self.diagnostics = {row.name: (row.level[0], row.message) for row in message.status}

    def until(self, done: Callable[[], object], what: str, seconds: float = PATIENCE) -> None:
        """Take what comes until something is so. End if it takes too long."""
        end = time.time() + seconds
        while not done():
            if time.time() > end:
                sys.exit(f"{what} took longer than {seconds:g} s: {self.diagnostics}")
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def during(self, seconds: float) -> None:
        """Take what comes for a time."""
        end = time.time() + seconds
        self.until(lambda: time.time() > end, "waiting", seconds + PATIENCE)

    def call(self, name: str) -> float:
        """Call a service, and return the seconds until its answer."""
        service = self.node.create_client(Trigger, f"/servolink/{name}")
        self.until(service.service_is_ready, name)
        begun = time.time()
        answer = service.call_async(Trigger.Request())
        self.until(answer.done, name)
        seconds = time.time() - begun
        assert answer.result().success, answer.result().message
        return seconds

    def ask(self, *points: tuple[float, float], names: tuple[str, ...] = (JOINT,), **more: Any) -> Any:
        """Send a goal of the action, and return its handle."""
        self.feedback.clear()
        self.until(self.action.server_is_ready, "the action")
        goal = FollowJointTrajectory.Goal(trajectory=trajectory(*points, names=names), **more)
        sent = self.action.send_goal_async(goal, feedback_callback=lambda one: self.feedback.append(one.feedback))
        self.until(sent.done, "the goal")
        assert sent.result().accepted
        return sent.result()

    def outcome(self, handle: Any) -> tuple[int, int, str]:
        """Return status, code and text of the result of a goal."""
        answer = handle.get_result_async()
        self.until(answer.done, "the result")
        found = answer.result()
        return found.status, found.result.error_code, found.result.error_string

    def moving(self) -> None:
        """Return when the joint turns."""
        self.track.clear()
        self.until(lambda: len({angle for _, angle in self.track}) > 3, "moving")

    def last_turn(self, since: float) -> float:
        """Return the seconds from `since` to the last reading in which the joint had turned."""
        self.during(2.0)
        turns = [after[0] for before, after in zip(self.track, self.track[1:], strict=False) if before[1] != after[1]]
        return max([turn - since for turn in turns if turn > since], default=0.0)

    def home(self) -> None:
        """Start the servos, and bring the joint to 0."""
        self.call("start")
        self.publisher.publish(trajectory((1.5, 0)))
        self.until(lambda: self.track[-1][1] == 0, "the way back")


def track_of_200_points(client: Client) -> None:
    """Measure how far the joint is from a trajectory of 200 points."""

    def angle(seconds: float) -> float:
        return 30 * math.sin(math.tau * seconds / 5)

    client.home()
    client.track.clear()
    begun = time.time()
    client.publisher.publish(trajectory(*((at / 20, angle(at / 20)) for at in range(1, 201))))
    client.during(11.0)
    for lag in (0.0, 0.02, 0.04, 0.06, 0.08, 0.1):
        off = [abs(found - angle(stamp - begun - lag)) for stamp, found in client.track if 0.5 < stamp - begun < 9.8]
        rms = math.sqrt(sum(one * one for one in off) / len(off))
        print(
            f"200 points in 10 s, up to 38 degrees/s, seen {lag:.2f} s late: rms {rms:.2f}, most {max(off):.2f} degrees"
        )
    assert abs(client.track[-1][1] - angle(10)) <= 1


def stops(client: Client) -> None:
    """Measure the answer of a stop, and how long the joint turns after it."""
    answers, turns = [], []
    for _ in range(5):
        client.home()
        client.publisher.publish(trajectory((0.5, 0), (8.0, 150)))
        client.moving()
        called = time.time()
        answers.append(client.call("stop"))
        turns.append(client.last_turn(called))
    print(f"stop: answer {1000 * median(answers):.0f} ms, most {1000 * max(answers):.0f} ms; ", end="")
    print(f"last turn seen {1000 * median(turns):.0f} ms after the call, most {1000 * max(turns):.0f} ms")
    assert median(turns) <= 0.1


def goals(client: Client) -> None:
    """Let goals of the action succeed, be refused, and be out of their tolerances."""
    aborted, result = GoalStatus.STATUS_ABORTED, FollowJointTrajectory.Result
    client.home()
    begun = time.time()
    assert client.outcome(client.ask((1.0, 20), (2.0, 40))) == (GoalStatus.STATUS_SUCCEEDED, result.SUCCESSFUL, "")
    seconds = time.time() - begun
    print(f"a goal of 2 s succeeded after {seconds:.2f} s, with {len(client.feedback)} times feedback")
    assert 2.0 <= seconds <= 3.0
    assert abs(client.track[-1][1] - 40) <= 2
    assert 10 <= len(client.feedback) <= 25
    last = client.feedback[-1]
    assert list(last.joint_names) == [JOINT]
    assert abs(last.desired.positions[0] - last.actual.positions[0] - last.error.positions[0]) < 1e-9
    for points, names, code, why in (
        ([(60.0, 900.0)], (JOINT,), result.INVALID_GOAL, "beyond a whole turn, and there are no limits; nothing was"),
        ([(0.1, 100.0)], (JOINT,), result.INVALID_GOAL, "faster than"),
        ([], (JOINT,), result.INVALID_GOAL, "has no points"),
        ([(1.0, 0.0)], ("tail",), result.INVALID_JOINTS, "names the joint 'tail'; this robot has"),
    ):
        status, found, text = client.outcome(client.ask(*points, names=names))
        assert (status, found) == (aborted, code), (status, found, text)
        assert why in text
    strict = [JointTolerance(name=JOINT, position=0.001)]
    status, found, text = client.outcome(client.ask((2.0, 0.0), path_tolerance=strict))
    assert (status, found) == (aborted, result.PATH_TOLERANCE_VIOLATED), text
    print(text)
    client.during(0.5)
    assert client.track[-1][1] > 20, "it did not hold where it was"
    status, found, text = client.outcome(client.ask((1.0, 30.5), goal_tolerance=strict))
    assert (status, found) == (aborted, result.GOAL_TOLERANCE_VIOLATED), text
    print(text)


def ended_goals(client: Client) -> None:
    """Let goals be replaced, cancelled and stopped."""
    aborted, code = GoalStatus.STATUS_ABORTED, FollowJointTrajectory.Result.INVALID_GOAL
    client.home()
    long = (0.5, 0.0), (4.0, 150.0)
    older = client.ask(*long)
    client.moving()
    newer = client.ask(*long)
    assert client.outcome(older) == (aborted, code, "a newer trajectory came")
    client.publisher.publish(trajectory(*long))
    assert client.outcome(newer)[2] == "a newer trajectory came"
    cancels = []
    for _ in range(5):
        client.home()
        handle = client.ask(*long)
        client.moving()
        called = time.time()
        handle.cancel_goal_async()
        assert client.outcome(handle) == (GoalStatus.STATUS_CANCELED, code, "the goal was cancelled")
        cancels.append(client.last_turn(called))
    print(f"cancel: last turn seen {1000 * median(cancels):.0f} ms after it, most {1000 * max(cancels):.0f} ms")
    assert max(cancels) <= 0.3
    topic = client.node.create_publisher(Empty, "stop", 1)
    for is_topic in (False, True):
        client.home()
        client.until(topic.get_subscription_count, "the topic")
        handle = client.ask(*long)
        client.moving()
        called = time.time()
        topic.publish(Empty()) if is_topic else client.call("stop")
        status, found, text = client.outcome(handle)
        print(f"stop: the goal ends with {text!r}, last turn {1000 * client.last_turn(called):.0f} ms after it")
        assert (status, found) == (aborted, code)
        assert "stopped" in text


def lease_of_another(client: Client) -> None:
    """Let a goal be refused while another program moves the robot: the joint stays where it was."""
    client.home()
    with servolink.sync.connect("share://arm?role=move") as other:
        client.until(partial(takes_lease, other), "the lease")
        client.track.clear()
        status, code, text = client.outcome(client.ask((2.0, 40)))
        client.during(2.5)
        print(f"while another program has the lease: {text!r}, the joint turned in {turns_in(client.track)} readings")
        assert (status, code) == (GoalStatus.STATUS_ABORTED, FollowJointTrajectory.Result.INVALID_GOAL)
        assert "moved by" in text
        assert turns_in(client.track) == 0


def takes_lease(other: servolink.sync.Board) -> bool:
    """Return whether another program is let to move a servo."""
    try:
        other.move({3: 5}, duration=0.1)
    except MotionRefused:
        return False
    return True


def turns_in(track: list[tuple[float, float]]) -> int:
    """Return how many readings differ from the one before."""
    return sum(before[1] != after[1] for before, after in pairwise(track))


def description(client: Client) -> None:
    """Receive the URDF as a late subscriber."""
    texts: list[str] = []
    late = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(String, "robot_description", lambda message: texts.append(message.data), late)
    client.until(lambda: texts, "the description")
    joints = re.findall(r'<joint name="([^"]+)" type="revolute"', texts[0])
    print(f"the description has {len(texts[0])} bytes and the joints {', '.join(joints)}")
    assert JOINT in joints


def death_of_a_client(client: Client, what: str, how: signal.Signals, lease: float) -> None:
    """Measure how long the joint turns after the end of the program that has sent the trajectory or the goal."""
    client.home()
    program = processes.start((sys.executable, "-m", __spec__.name, what, str(lease)))
    client.moving()
    processes.finish(program, how)
    ended = time.time()
    seconds = client.last_turn(ended)
    client.during(1.0)
    print(f"{how.name} of a {what}, lease {lease:g} s: last turn seen {1000 * seconds:.0f} ms later")
    assert client.track[-1][1] < 140, "it went to the end"
    assert seconds <= 1.0
    assert client.diagnostics["servolink: motion"] == (
        1,
        "the motion was ended, as the program that sent the trajectory is gone",
    )


def mover(what: str, lease: float) -> None:
    """Send a trajectory or a goal when the robot listens, and live on."""
    rclpy.init(args=[])
    node = rclpy.create_node("mover")
    qos = QoSProfile(depth=1)
    if lease:
        qos.liveliness, qos.liveliness_lease_duration = LivelinessPolicy.AUTOMATIC, Duration(seconds=lease)
    publisher = node.create_publisher(JointTrajectory, "joint_trajectory", qos)
    while not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.05)
    way = trajectory((0.5, 0), (8.0, 150))
    if what == "asker":
        action = ActionClient(node, FollowJointTrajectory, "/servolink/follow_joint_trajectory")
        action.wait_for_server()
        action.send_goal_async(FollowJointTrajectory.Goal(trajectory=way))
    else:
        publisher.publish(way)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        node.destroy_node()


def garbage(client: Client, door: int) -> None:
    """Send what must be refused, then a flood of it, beside which a stop must go through."""
    wrong = {
        "beyond 1e+06": trajectory((1, NAN)),
        "names the joint 'tail'": trajectory((1, 0), names=("tail",)),
        "has 1 positions for 2 joints": trajectory((1, 0)),
        "not later than": trajectory((1, 0), (1, 0)),
        "beyond a whole turn": trajectory((60, 900)),
        "has 10001 points": trajectory(*((at / 10, 0) for at in range(10_001))),
    }
    wrong["has 1 positions for 2 joints"].joint_names.append("servo_2")

    def is_refused(why: str) -> bool:
        return why in client.diagnostics["servolink: motion"][1]

    for why, message in wrong.items():
        client.publisher.publish(message)
        client.until(partial(is_refused, why), why)
    client.home()
    client.publisher.publish(trajectory((0.5, 0), (20.0, 150)))
    client.moving()
    messages = [message for message in wrong.values() if len(message.points) < 10]  # others take longer to send
    before = memory(door)
    begun, sent, ages = time.time(), 0, len(client.ages)
    while (now := time.time() - begun) < 10.0:
        while sent < now * FLOOD:
            client.publisher.publish(messages[sent % len(messages)])
            sent += 1
        rclpy.spin_once(client.node, timeout_sec=0)
    grown = memory(door) - before
    print(f"{sent / now:.0f} wrong messages a second for {now:.0f} s: memory grew by {grown / 1e6:.1f} MB, ", end="")
    print(f"states {1000 * median(client.ages[ages:]):.1f} ms old")
    turned = client.track[-1][1] > 30
    called = time.time()
    print(f"a stop right after it: answer {1000 * client.call('stop'):.0f} ms, ", end="")
    print(f"last turn seen {1000 * client.last_turn(called):.0f} ms later")
    assert turned, "the motion did not go on"
    assert grown < 20e6


def memory(process: int) -> int:
    """Return the bytes of memory that a process has."""
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{process}/status").read_text())
    assert found is not None
    return 1024 * int(found[1])


@contextmanager
def served(project: Path) -> Iterator[int]:
    """Serve a virtual board to ROS with a figure, in a project that is written; yield the id of the process."""
    captions = ServoParameter(1, 0, "servo 1"), ServoParameter(2, 0, "servo 2")
    save_project(str(project), Project(servo_parameters=captions), figure=ARM)
    door = processes.start(
        (
            *(sys.executable, "-m", "servolink", "ros2", "--board", "share://arm", "--speed-cap", "200"),
            *("--project", str(project)),
        )
    )
    assert door.stdout is not None
    assert door.stdout.readline() == "ros2 /servolink\n"
    try:
        yield door.pid
    finally:
        out, log = processes.finish(door, signal.SIGTERM)
        print(f"{out}the log of the node has {log.count(chr(10))} lines")
        assert "Traceback" not in log, log


def main() -> None:
    """Measure all, in about five minutes."""
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": "77"}
    with (
        TemporaryDirectory() as folder,
        shared("virtual://?servos=6", "arm"),
        served(Path(folder) / "arm.servolink.json") as door,
    ):
        client = Client()
        client.until(lambda: client.track and client.publisher.get_subscription_count(), "discovery")
        client.ages.clear()
        client.during(10.0)
        aged = sorted(client.ages)
        print(f"states: {len(aged) / 10:.1f} a second, {1000 * median(aged):.1f} ms old", end="")
        print(f", p99 {1000 * aged[len(aged) * 99 // 100]:.1f} ms")
        assert median(aged) <= 0.01
        description(client)
        goals(client)
        ended_goals(client)
        lease_of_another(client)
        track_of_200_points(client)
        stops(client)
        for what in ("mover", "asker"):
            death_of_a_client(client, what, signal.SIGINT, 0.0)
            death_of_a_client(client, what, signal.SIGKILL, 0.4)
        garbage(client, door)
        client.node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    mover(sys.argv[1], float(sys.argv[2])) if sys.argv[1:] else main()
