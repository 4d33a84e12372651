"""Node of ROS 2 on a thread of its own, between its executor and the event loop of a follower."""

# pyright: reportMissingImports=false, reportOptionalMemberAccess=false

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Collection, Coroutine, Iterable, Mapping, Sequence
from functools import partial
from threading import Thread
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionServer, CancelResponse
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from servolink.client import Board, connect
from servolink.control import Greeting, open_channel, this_program
from servolink.doctor import Finding, SystemFacts, checks_before_opening
from servolink.errors import ServolinkError
from servolink.gateways.ros.joint_follower import HZ, JointFollower, Log, RosStatus
from servolink.gateways.ros.trajectories import RosGoal, joints_of
from servolink.project import ProjectFile
from servolink.support import Tasks
from servolink.twin import to_urdf

try:
    from control_msgs.action import FollowJointTrajectory as Action
except ImportError:  # an installed ROS has it; it is on no package index
    Action = None

_ACTION = "~/follow_joint_trajectory"
_MOST_BYTES = 1_048_576
_LISTED = 0.3  # seconds after which ROS no longer lists a publisher that has left
_LIVELY = Duration(seconds=0.5)  # longest lease of liveliness that is watched
_STOP_LIMIT = 10.0  # seconds for which the executor waits for the event loop


class RosNode:
    """Publishers, subscriptions and services of a robot. Public methods are for the event loop."""

    def __init__(self, follower: JointFollower, urdf: str) -> None:
        """Begin the node, and its thread. `urdf` is the description of the robot; empty for none."""
        self._ended = asyncio.Event()
        self._follower = follower
        self._loop = asyncio.get_running_loop()
        # ROS itself would open the robot to all programs of the network.
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        node = self._node = rclpy.create_node("servolink", context=self._context, start_parameter_services=False)
        self._states = node.create_publisher(JointState, "joint_states", 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, "diagnostics", 10)
        if urdf:  # late subscribers receive the description too
            described = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            node.create_publisher(String, "robot_description", described).publish(String(data=urdf))
        left = SubscriptionEventCallbacks(matched=self._match, use_default_callbacks=False)
        last = QoSProfile(depth=1)
        node.create_subscription(JointTrajectory, "joint_trajectory", self._hear, last, raw=True, event_callbacks=left)
        self._lively: Any = None
        node.create_subscription(Empty, "stop", lambda message: self._done(follower.stop()), last)
        node.create_service(Trigger, "~/stop", lambda request, response: self._answer(response, follower.stop()))
        node.create_service(Trigger, "~/start", lambda request, response: self._answer(response, follower.start()))
        if Action:  # a result is kept for 2 s, as all are in a flood of goals
            calls = {"handle_accepted_callback": self._begin, "cancel_callback": self._cancel}
            ActionServer(node, Action, _ACTION, _result, **calls, result_timeout=2)
            # Publishes nothing: each client subscribes to the feedback, and ROS tells no action server who leaves.
            unmatched = PublisherEventCallbacks(matched=self._lose_client, use_default_callbacks=False)
            feedback = Action.Impl.FeedbackMessage, f"{_ACTION}/_action/feedback"
            node.create_publisher(*feedback, last, event_callbacks=unmatched)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = Thread(target=self._spin, name="servolink ROS")
        self._thread.start()

    @staticmethod
    def decode(data: bytes) -> Any:
        """Return the trajectory in a message. Raise an error of any kind for other bytes, or too many."""
        if len(data) > _MOST_BYTES:
            raise ValueError(f"{len(data)} bytes; at most {_MOST_BYTES} are allowed")
        return deserialize_message(data, JointTrajectory)

    def publish_states(self, angles: Mapping[str, float], at: float) -> None:
        """Publish angles in radians by joint, read at `at` in seconds of the system's clock."""
        message = JointState(name=list(angles), position=list(angles.values()))
        message.header.stamp = _stamp(at)
        self._states.publish(message)

    def publish_diagnostics(self, statuses: Iterable[RosStatus], hub: str) -> None:
        """Publish rows of the diagnostics."""
        message = DiagnosticArray()
        message.header.stamp = _stamp(time.time())
        for name, level, text, values in statuses:
            row = DiagnosticStatus(level=bytes([level]), name=f"servolink: {name}", message=text, hardware_id=hub)
            row.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
            message.status.append(row)
        self._diagnostics.publish(message)

    async def fail(self) -> None:
        """Raise ServolinkError if the thread ends early."""
        await self._ended.wait()
        raise ServolinkError("ROS 2 has ended with an error, which it has printed; start the command again")

    def close(self) -> None:
        """End the thread and the node; to be called on another thread than that of the event loop."""
        self._executor.shutdown()
        self._thread.join()  # before the end of the context, or the process would abort
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def _spin(self) -> None:
        try:
            self._executor.spin()
        finally:
            self._loop.call_soon_threadsafe(self._ended.set)

    def _hear(self, data: bytes, info: Any) -> None:
        self._follower.hear(data[: _MOST_BYTES + 1], info["publisher_gid"]["data"])

    def _match(self, event: Any) -> None:
        """Notice publishers that leave, and begin to watch the liveliness of publishers with an offer of liveliness."""
        found = self._publishers()
        if _has_left(event):
            for delay in (0.0, _LISTED):
                self._loop.call_soon_threadsafe(self._loop.call_later, delay, self._look)
        # Not before: ROS warns every publisher without an offer about a subscription that does not match.
        if self._lively is None and any(each.qos_profile.liveliness_lease_duration <= _LIVELY for each in found):
            asked = QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC, liveliness_lease_duration=_LIVELY)
            events = SubscriptionEventCallbacks(liveliness=self._miss, use_default_callbacks=False)
            self._lively = self._node.create_subscription(
                JointTrajectory, "joint_trajectory", lambda data: None, asked, raw=True, event_callbacks=events
            )

    def _publishers(self) -> Sequence[Any]:
        found: Sequence[Any] = self._node.get_publishers_info_by_topic(
            self._node.resolve_topic_name("joint_trajectory")
        )
        return found

    def _look(self) -> None:
        if not self._ended.is_set():
            self._follower.left({bytes(each.endpoint_gid) for each in self._publishers()})

    def _lose_client(self, event: Any) -> None:
        if _has_left(event):
            self._loop.call_soon_threadsafe(self._follower.client_left)

    def _miss(self, event: Any) -> None:
        """Tell of a publisher whose process shows no sign of life."""
        if event.not_alive_count_change > 0:
            self._loop.call_soon_threadsafe(self._follower.left, None)

    def _done(self, work: Coroutine[Any, Any, str]) -> tuple[bool, str]:
        """Return whether work on the event loop succeeded, and its text. The executor waits: a flood is held back."""
        try:
            return True, asyncio.run_coroutine_threadsafe(work, self._loop).result(_STOP_LIMIT)
        except (ServolinkError, TimeoutError) as error:
            return False, str(error)

    def _begin(self, handle: Any) -> None:
        """Follow a goal; its result is given on the thread of ROS, where awaiting one would keep the executor busy."""
        end, show = self._executor.create_task, partial(_feed, handle)
        handle.goal = RosGoal(handle.request, lambda *result: end(handle.execute, partial(_result, result)), show)
        self._follower.hear(b"", b"", handle.goal)

    def _cancel(self, handle: Any) -> Any:
        self._loop.call_soon_threadsafe(self._follower.abandon, handle.goal)
        return CancelResponse.ACCEPT

    def _answer(self, response: Any, work: Coroutine[Any, Any, str]) -> Any:
        response.success, response.message = self._done(work)
        return response


async def serve_ros(hub: str, project: ProjectFile | None, speed_cap: float, log: Log, *, outlive: bool) -> None:
    """Serve the robot of the hub named `hub` as the node `servolink`, and raise ServolinkError when hub or ROS ends.

    All motions are slower than `speed_cap` degrees per second. With `outlive`, a trajectory goes on without the sender.
    """
    channel, welcome = await open_channel(hub, Greeting(wants="rpc", who=this_program(), role="watch"))
    try:
        found = await asyncio.to_thread(checks_before_opening, SystemFacts(), [welcome.url])
        findings = [each for each in found if each.check != "in use"]
        async with connect(f"share://{hub}?role=move", speed_cap=speed_cap) as board:
            captions = dict.fromkeys(await board.servo_ids(), "")
            stored = await board.servo_parameters() if project is None else project.project.servo_parameters
            captions |= {one.servo_id: one.servo_caption for one in stored if one.servo_id in captions}
            urdf = "" if project is None or project.figure is None else to_urdf(project.figure, captions)
            joints = joints_of(captions, urdf)
            follower = JointFollower(board, joints, RosNode.decode, log, outlive=outlive)
            channel.on_notification = follower.hear_hub
            await channel.call("board.state")  # the hub notifies only programs with a request
            node = RosNode(follower, urdf)
            log(f"joints {', '.join(joints)}")
            if not Action:
                log("no action FollowJointTrajectory, as there is no package control_msgs of ROS")
            tasks = Tasks()
            works = follower.follow(), _publish(node, follower, board), _diagnose(node, follower, findings, hub)
            begun = [tasks.begin(work) for work in (*works, node.fail())]
            try:
                done, _ = await asyncio.wait(begun, return_when=asyncio.FIRST_COMPLETED)
                done.pop().result()
            finally:
                await tasks.close()
                await asyncio.to_thread(node.close)
    finally:
        await channel.close()


async def _publish(node: RosNode, follower: JointFollower, board: Board) -> None:
    """Publish each reading of the servos. Raise ConnectionLost at the end of the hub."""
    async for follower.latest in board.watch(HZ):
        ago = asyncio.get_running_loop().time() - follower.latest.seconds
        node.publish_states(follower.angles_in(follower.latest), time.time() - ago)


async def _diagnose(node: RosNode, follower: JointFollower, findings: Collection[Finding], hub: str) -> None:
    """Publish the diagnostics once a second."""
    while True:
        node.publish_diagnostics(follower.statuses(findings), hub)
        await asyncio.sleep(1.0)


def _has_left(event: Any) -> bool:
    """Return whether any endpoint has left, though others may have come meanwhile."""
    return bool(event.total_count_change > event.current_count_change)


def _result(result: tuple[int, str], handle: Any) -> Any:
    (handle.canceled if handle.is_cancel_requested else handle.abort if result[0] else handle.succeed)()
    return Action.Result(error_code=result[0], error_string=result[1])


def _feed(handle: Any, wanted: Mapping[str, float], off: Mapping[str, float]) -> None:
    """Publish where the joints of a goal are."""
    message = Action.Feedback(joint_names=list(off))
    message.header.stamp = _stamp(time.time())
    message.desired.positions = [wanted[name] for name in off]
    message.actual.positions = [wanted[name] - error for name, error in off.items()]
    message.error.positions = list(off.values())
    handle.publish_feedback(message)


def _stamp(seconds: float) -> Any:
    whole, rest = divmod(round(seconds * 1e9), 10**9)
    return Time(sec=whole, nanosec=rest)
