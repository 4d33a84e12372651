"""Trajectories followed on a virtual board behind a hub, as ROS would send them; `ros_runs.py` has ROS itself.

Modules: servolink.gateways.ros.joint_follower, servolink.gateways.ros.ros_node, servolink.cli.together.ros2.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.client import connect
from servolink.control import Greeting, open_channel
from servolink.doctor import Finding
from servolink.errors import RequestRefused
from servolink.gateways.ros.joint_follower import HZ, JointFollower
from servolink.gateways.ros.trajectories import RosGoal
from servolink.protocol import ExecuteActionRequest
from tests.gateways.robots import GUARD, RobotSeen, shared_robot
from tests.gateways.test_ros_trajectories import goal_message, message, point, row

JOINTS = {"arm": 1, "left_knee": 2, "foot": 3}
SLOW = message(["arm"], point(30, 60))


class Messages:
    """Messages by the bytes that stand for them."""

    def __init__(self) -> None:
        self._by_data: dict[bytes, Any] = {}

    def data(self, message: Any) -> bytes:
        data = b"%d" % len(self._by_data)
        self._by_data[data] = message
        return data

    def decode(self, data: bytes) -> Any:
        return self._by_data[data]


class Scene:
    """A follower, and the robot that it moves."""

    def __init__(self, robot: RobotSeen, follower: JointFollower, messages: Messages) -> None:
        self.robot = robot
        self.follower = follower
        self._messages = messages

    def hear(self, message: Any, sender: bytes = b"sender") -> None:
        """Let the follower hear a message on another thread, as that of ROS."""
        thread = threading.Thread(target=self.follower.hear, args=(self._messages.data(message), sender))
        thread.start()
        thread.join()

    def rows(self) -> dict[str, tuple[int, str]]:
        return {row.name: (row.level, row.text) for row in self.follower.statuses(())}

    async def moving(self) -> None:
        """Return when set-points are sent."""
        seen = len(self.robot.motions)
        await self.robot.until(lambda: len(self.robot.motions) > seen + 3)

    async def still(self) -> None:
        """Return when the follower is idle."""
        await self.robot.until(lambda: self.follower._motion is None and not self.follower._checked)

    async def angle(self, servo_id: int) -> int:
        return (await self.robot.board.servo(servo_id)).angle


def on_scene(use: Callable[[Scene], Awaitable[None]], *, outlive: bool = False) -> None:
    async def main() -> None:
        async with (
            asyncio.timeout(GUARD),
            shared_robot() as robot,
            connect("share://rex?role=move", speed_cap=200.0) as board,
        ):
            messages = Messages()
            follower = JointFollower(board, JOINTS, messages.decode, robot.log.append, outlive=outlive)
            channel, _ = await open_channel("rex", Greeting(wants="rpc", who="ros", role="watch"))
            channel.on_notification = follower.hear_hub
            await channel.call("board.state")
            robot.motions.clear()
            following = asyncio.create_task(follower.follow())
            try:
                await use(Scene(robot, follower, messages))
            finally:
                following.cancel()
                await asyncio.wait([following])
                await channel.close()

    asyncio.run(main())


def test_a_trajectory_is_followed_to_its_end() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(message(["left_knee", "arm"], point(0.3, 20, -10), point(0.6, 10, 10)))
        await scene.robot.until(lambda: "followed a trajectory for 0.6 s" in scene.robot.log)
        assert set(scene.robot.motions) == {ExecuteActionRequest.packet_id}
        assert len(scene.robot.motions) <= 0.6 * HZ + 2
        await scene.robot.until(lambda: len(scene.robot.motions) > 1)
        async for reading in scene.robot.board.watch(HZ):
            angles = scene.follower.angles_in(reading)
            if angles == pytest.approx({"arm": math.radians(10), "left_knee": math.radians(10), "foot": 0.0}):
                break

    on_scene(use)


def test_what_is_wrong_is_refused_in_log_and_diagnostics_and_the_motion_goes_on() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        scene.hear(message(["tail"], point(1, 0)))
        await scene.robot.until(lambda: "tail" in scene.rows()["motion"][1])
        assert scene.rows()["motion"][0] == 1
        assert scene.robot.log[-1].endswith("nothing was moved")
        for _ in range(200):
            scene.follower.hear(b"no message", b"sender")
        await scene.robot.until(lambda: "cannot be read" in scene.rows()["motion"][1])
        assert len(scene.robot.log) == 1, "a flood does not fill the log"
        await scene.moving()

    on_scene(use)


def test_a_newer_trajectory_takes_the_place_of_the_motion_and_an_empty_one_ends_it() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        scene.hear(message(["foot"], point(30, 60)))
        await scene.moving()
        before = await scene.angle(1)
        await scene.robot.until(lambda: scene.rows()["motion"] == (0, "follows a trajectory"))
        scene.hear(message([]))
        await scene.still()
        seen = len(scene.robot.motions)
        assert await scene.angle(1) == before
        assert scene.rows()["motion"] == (0, "idle")
        assert len(scene.robot.motions) <= seen + 1, "one set-point may have been on its way"
        assert scene.robot.stops == 0

    on_scene(use)


@pytest.mark.parametrize("senders", [{b"other"}, set(), None])
def test_a_motion_ends_with_the_program_that_sent_it(senders: set[bytes] | None) -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        scene.follower.left({b"other", b"sender"})
        scene.follower.client_left()
        await scene.moving()
        scene.follower.left(senders)
        await scene.still()
        assert "the motion was ended, as the program that sent the trajectory is gone" in scene.robot.log

    on_scene(use)


def test_a_motion_outlives_its_sender_if_that_is_asked_for() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        scene.follower.left(None)
        await scene.moving()

    on_scene(use, outlive=True)


def test_a_stop_ends_the_motion_and_nothing_moves_before_a_start() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        assert await scene.follower.stop() == "all servos are stopped and held"
        assert scene.robot.stops >= 1
        await scene.robot.until(lambda: scene.rows()["guard"][0] == 1)
        seen = len(scene.robot.motions)
        scene.hear(SLOW)
        await scene.robot.until(lambda: "is stopped" in scene.rows()["motion"][1])
        assert len(scene.robot.motions) == seen
        assert await scene.follower.start() == "all servos are held and started"
        scene.hear(SLOW)
        await scene.moving()

    on_scene(use)


def test_a_stop_of_another_program_ends_the_motion_and_is_shown() -> None:
    async def use(scene: Scene) -> None:
        scene.hear(SLOW)
        await scene.moving()
        async with connect("share://rex?role=watch") as other:
            await other.stop()
        await scene.still()
        level, text = scene.rows()["guard"]
        assert level == 1
        assert text.endswith("has stopped all servos")

    on_scene(use)


def test_a_trajectory_is_refused_while_another_program_moves_the_robot() -> None:
    async def use(scene: Scene) -> None:
        async with connect("share://rex?role=move") as other:
            await other.move({3: 5}, duration=0.02)
            before = await scene.angle(1)
            scene.hear(SLOW)
            await scene.robot.until(lambda: "are moved by" in scene.rows()["motion"][1])
            await scene.still()
            assert len(scene.robot.motions) == 1, "only the motion of the other program reached the board"
            assert await scene.angle(1) == before

    on_scene(use)


def test_diagnostics_have_board_joints_and_what_doctor_has_found() -> None:
    async def use(scene: Scene) -> None:
        assert scene.rows()["board"] == (2, "no readings of the servos")
        assert scene.rows()["joint foot"] == (2, "not reported")
        async for reading in scene.robot.board.watch(HZ):
            scene.follower.latest = reading
            found = Finding("latency timer", "16 ms", "slow", "set it")
            rows = {row.name: row for row in scene.follower.statuses([found])}
            assert rows["board"][1:3] == (0, "answers")
            assert rows["joint foot"][1:3] == (0, "ready")
            assert rows["joint foot"].values["angle"] == 0
            assert rows["doctor: latency timer"][1:] == (1, "16 ms", {"meaning": "slow", "remedy": "set it"})
            break

    on_scene(use)


def test_a_start_needs_the_right_to_move() -> None:
    async def main() -> None:
        async with shared_robot() as robot, connect("share://rex?role=watch") as board:
            follower = JointFollower(board, JOINTS, Messages().decode, robot.log.append, outlive=False)
            with pytest.raises(RequestRefused, match="needs the role move"):
                await follower.start()

    asyncio.run(main())


def test_goals_are_reached_replaced_cancelled_stopped_and_refused() -> None:
    async def use(scene: Scene) -> None:
        results: list[tuple[int, str]] = []

        def ask(trajectory: Any, **more: Any) -> RosGoal:
            goal = RosGoal(goal_message(trajectory, **more), lambda *each: results.append(each))
            scene.follower.hear(b"", b"", goal)
            return goal

        async def result() -> tuple[int, str]:
            await scene.robot.until(lambda: bool(results))
            return results.pop()

        async def look() -> None:
            async for reading in scene.robot.board.watch(HZ):
                scene.follower.latest = reading

        looking = asyncio.create_task(look())
        ask(message(["arm"], point(0.4, 10)), late=60)
        assert await result() == (0, "")
        assert await scene.angle(1) == 10
        ask(message(["tail"], point(0.4, 10)))
        code, text = await result()
        assert (code, text.startswith("the trajectory names the joint 'tail'")) == (-2, True)
        ask(message(["arm"], point(0, 170)))
        code, text = await result()
        assert (code, "faster than" in text) == (-1, True)
        ask(SLOW)
        await scene.moving()
        goal = ask(SLOW)
        assert await result() == (-1, "a newer trajectory came")
        await scene.moving()
        scene.follower.left(())
        await scene.moving()
        scene.follower.abandon(goal)
        assert await result() == (-1, "the goal was cancelled")
        await scene.still()
        ask(message(["arm"], point(30, 60)), path_tolerance=[row("arm", 1e-9)])
        code, text = await result()
        assert (code, "degrees from the trajectory" in text) == (-4, True)
        assert await scene.angle(1) < 30
        for leave in (scene.follower.client_left, lambda: scene.follower.left(None)):
            ask(SLOW)
            await scene.moving()
            leave()
            assert await result() == (-1, "the motion was ended, as the program that sent the trajectory is gone")
            await scene.still()
        ask(SLOW)
        await scene.moving()
        async with connect("share://rex?role=watch") as other:
            await other.stop()
        code, text = await result()
        assert (code, "stop" in text) == (-1, True)
        looking.cancel()
        await asyncio.wait([looking])

    on_scene(use)
