"""Motions for ROS: the newest trajectory is checked and followed by set-points, until the sender is gone.

Nothing here imports ROS. Trajectories come from the thread of ROS, and only the newest trajectory waits.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec
from msgspec import Raw

from servolink.client import Board, ServoReading, ServoStream
from servolink.control import ProblemNotice, StoppedNotice
from servolink.doctor import Finding
from servolink.errors import MotionRefused, ServolinkError, escape
from servolink.gateways.ros.trajectories import PATH_VIOLATED, RosGoal, Trajectory, read_trajectory, seconds_until
from servolink.motion import Degrees

HZ: Final = 50.0
"""Set-points and readings a second."""

_RECENT = 10.0  # seconds for which a refusal or a problem is a warning

Decode: TypeAlias = Callable[[bytes], Any]
"""Returns the message in bytes, or raises an error of any kind."""
Log: TypeAlias = Callable[[str], None]


class RosStatus(NamedTuple):
    """Row of the diagnostics that ROS tools show."""

    name: str
    level: int  # 0 good, 1 a warning, 2 an error
    text: str
    values: Mapping[str, object] = {}


class _Heard(NamedTuple):
    """Trajectory as received, with the stream that a stop since then has ended."""

    data: bytes
    sender: bytes
    at: float  # on the clock of the event loop
    goal: RosGoal
    stream: ServoStream


class JointFollower:
    """Follower of the newest trajectory. Only `hear` may be called on other threads."""

    def __init__(self, board: Board, joints: Mapping[str, int], decode: Decode, log: Log, *, outlive: bool) -> None:
        """Move `joints`, servo ids by name; with `outlive`, a motion goes on when the sender is gone."""
        self.joints = joints
        self.latest: ServoReading | None = None
        self._refused = 0
        self._board = board
        self._decode = decode
        self._log = log
        self._outlive = outlive
        self._loop = asyncio.get_running_loop()
        self._newest: deque[tuple[bytes, bytes, float, RosGoal]] = deque(maxlen=1)
        self._has_newest = asyncio.Event()
        self._checked: _Heard | None = None
        self._motion: tuple[_Heard, asyncio.Task[None]] | None = None
        self._stopped = RosStatus("guard", 0, "no stop since the last motion")
        self._trouble: dict[str, tuple[float, str]] = {}  # time and text of the latest refusal and problem

    def hear(self, data: bytes, sender: bytes, goal: RosGoal | None = None) -> None:
        """Keep a trajectory in place of the waiting trajectory; `sender` identifies the publisher."""
        with suppress(IndexError):
            self._loop.call_soon_threadsafe(self._newest.pop()[3].settle, "a newer trajectory came")
        self._newest.append((data, sender, self._loop.time(), goal or RosGoal()))
        if not self._has_newest.is_set():
            self._loop.call_soon_threadsafe(self._has_newest.set)

    async def follow(self) -> None:
        """Obey what is heard, until cancelled; the servos then keep their latest set-points."""
        try:
            while True:
                await self._has_newest.wait()
                self._has_newest.clear()
                with suppress(IndexError):  # a stop has emptied it
                    await self._obey(_Heard(*self._newest.pop(), self._board.stream(HZ)))
        finally:
            self._end("", "the node of servolink has ended")

    def abandon(self, goal: RosGoal) -> None:
        """End the motion of a goal, as its sender wishes; the servos keep their latest set-points."""
        if goal in [each for _, each in self._under_way()]:
            self._end("", "the goal was cancelled")

    def left(self, senders: Collection[bytes] | None) -> None:
        """End a trajectory of the topic unless its publisher is among `senders`, those left. None: end any motion."""
        movers = {sender for sender, goal in self._under_way() if goal.message is None or senders is None}
        if movers and (senders is None or not movers <= {*senders}):
            self._lose_sender()

    def client_left(self) -> None:
        """End a goal, as any client of the action may have sent it: ROS does not say which."""
        if any(goal.message for _, goal in self._under_way()):
            self._lose_sender()

    async def stop(self) -> str:
        """Stop all servos, and return what was done. Raise OutcomeUnknown without a report of all servos."""
        self._end("", "all servos were stopped")
        await self._board.stop()
        return "all servos are stopped and held"

    async def start(self) -> str:
        """Hold and start all servos after a stop, and return what was done. Raise ServolinkError if refused."""
        await self._board.set_servo("all", start=True, hold=True)
        return "all servos are held and started"

    def hear_hub(self, method: str, params: Raw) -> None:
        """Take a notification of the hub: a stop, the guard's too, and problems."""
        if method == "stopped":
            notice = msgspec.json.decode(params, type=StoppedNotice)
            why = "" if notice.stalled is None else f": {escape(notice.reason)}"
            text = f"{escape(notice.by or 'the hub')} has stopped all servos{why}"
            self._stopped = RosStatus("guard", 1 if notice.stalled is None else 2, text)
            self._end(text)
        elif method == "problem":
            self._note("problem", escape(msgspec.json.decode(params, type=ProblemNotice).text))

    def statuses(self, findings: Collection[Finding]) -> Iterator[RosStatus]:
        """Yield the diagnostics: board, motion, guard, each joint, and what doctor has found."""
        now, stats, reading = self._loop.time(), self._board.stats, self.latest
        counts = {"timeouts": stats.timeouts, "retries": stats.retries, "noise in bytes": stats.noise}
        is_late = reading is None or now - reading.seconds > 1.0
        yield RosStatus("board", 2 if is_late else 0, "no readings of the servos" if is_late else "answers", counts)
        texts = {what: text for what, (at, text) in self._trouble.items() if now - at < _RECENT}
        activity = "follows a trajectory" if self._motion else "idle"
        yield RosStatus("motion", int(bool(texts)), "; ".join(texts.values()) or activity, {"refused": self._refused})
        yield self._stopped
        by_id = {} if reading is None else {servo.servo_id: servo for servo in reading.servos}
        for name, servo_id in self.joints.items():
            if (servo := by_id.get(servo_id)) is None:
                yield RosStatus(f"joint {name}", 2, "not reported")
                continue
            raw = {"angle": servo.angle, "current": servo.current, "temperature": servo.temperature}
            yield RosStatus(f"joint {name}", int(servo.state != "ready"), escape(servo.state), raw)
        for found in findings:
            values = {"meaning": found.meaning, "remedy": found.remedy}
            yield RosStatus(f"doctor: {found.check}", int(not found.is_harmless), escape(found.observation), values)

    def angles_in(self, reading: ServoReading) -> dict[str, float]:
        """Return the angles of a reading by joint, in radians, without those that cannot be true."""
        angles = {servo.servo_id: math.radians(servo.angle) for servo in reading.servos if _is_angle(servo)}
        return {name: angles[servo_id] for name, servo_id in self.joints.items() if servo_id in angles}

    async def _obey(self, heard: _Heard) -> None:
        """Check a trajectory, and replace the motion under way."""
        self._checked, found = heard, None
        try:
            found = await asyncio.to_thread(self._read, heard)
        except MotionRefused as error:
            self._checked = None
            self._refuse(error, heard.goal)
        if found and self._checked:  # neither a stop nor the end of the sender came meanwhile
            if self._motion:
                self._motion[1].cancel()
                self._motion[0].goal.settle("a newer trajectory came")
            self._checked = self._motion = None
            if found[1] is not None:
                self._motion = heard, self._loop.create_task(self._follow(heard, found[1], found[0]))

    def _read(self, heard: _Heard) -> tuple[float, Trajectory | None]:
        try:
            message = heard.goal.message.trajectory if heard.goal.message else self._decode(heard.data)
        except Exception as error:  # raised by ROS, of any kind
            raise MotionRefused(f"a message was ignored, as it cannot be read: {escape(str(error))[:200]}") from error
        stamp = message.header.stamp
        trajectory = read_trajectory(message, self.joints, self._board.limits)
        if heard.goal.message:
            heard.goal.check()
        return seconds_until(stamp.sec + stamp.nanosec * 1e-9, time.time()), trajectory

    async def _follow(self, heard: _Heard, trajectory: Trajectory, delay: float) -> None:
        """Send set-points to the end of a trajectory, each for the time at which the servos arrive there."""
        try:
            await asyncio.sleep(delay)
            pose = {servo.servo_id: servo.angle for servo in await self._board.servos() if _is_angle(servo)}
            if lacking := [each for each in trajectory.servo_ids if each not in pose]:
                raise MotionRefused(f"the trajectory was not begun: servo {lacking[0]} reports no angle in degrees")
            trajectory = trajectory.beginning_at(pose, self._board.limits)
            begun, end, ahead = heard.at + delay, trajectory.seconds[-1], 0.0
            self._stopped = self._stopped._replace(level=0)
            while not self._sees(heard.goal, trajectory, begun) or ahead < end:
                ahead = min(self._loop.time() - begun + 1 / HZ, end)
                await heard.stream.send(trajectory.at(ahead))
            heard.goal.settle("", 0)
            self._log(f"followed a trajectory for {end:.1f} s")
        except ServolinkError as error:
            if getattr(error, "code", 0) <= PATH_VIOLATED and self.latest:
                here = {each.servo_id: each.angle for each in self.latest.servos if _is_angle(each)}
                with suppress(ServolinkError):  # no servo shall go on toward its set-point
                    await heard.stream.send({each: here[each] for each in trajectory.servo_ids if each in here})
            self._refuse(error, heard.goal)
        finally:
            if self._motion is not None and self._motion[1] is asyncio.current_task():
                self._motion = None

    def _sees(self, goal: RosGoal, trajectory: Trajectory, begun: float) -> bool:
        """Return whether nothing is left to wait for. Raise TrajectoryRefused if the latest reading is far off."""
        reading, now = self.latest or ServoReading(begun, ()), self._loop.time() - begun
        return not goal.message or goal.see(trajectory, now, reading.seconds - begun, self.angles_in(reading))

    def _lose_sender(self) -> None:
        if not self._outlive:
            self._end("the motion was ended, as the program that sent the trajectory is gone")

    def _under_way(self) -> list[tuple[bytes, RosGoal]]:
        """Return sender and goal of what is checked, moves or waits."""
        heard = self._checked, self._motion and self._motion[0], *list(self._newest)
        return [(each[1], each[3]) for each in heard if each]

    def _end(self, why: str, result: str = "") -> None:
        """End the motion, what is checked and what waits. Texts: `why` for all, or only a result for goals."""
        if why and (self._motion or self._checked):
            self._note("motion", why)
        ended, motion, self._motion, self._checked = self._under_way(), self._motion, None, None
        self._newest.clear()
        if motion:
            motion[1].cancel()
        for _, goal in ended:
            goal.settle(why or result)

    def _refuse(self, error: ServolinkError, goal: RosGoal) -> None:
        self._refused += 1
        self._note("refusal", str(error))
        goal.settle(str(error), getattr(error, "code", -1))  # INVALID_GOAL for other errors

    def _note(self, what: str, text: str) -> None:
        """Show a text in the diagnostics, and log each text once a second at most."""
        now, (logged, _) = self._loop.time(), self._trouble.get(what, (-math.inf, ""))
        if now - logged >= 1.0:
            logged = now
            self._log(text)
        self._trouble[what] = (logged, text)


def _is_angle(servo: Any) -> bool:
    return isinstance(servo.angle, Degrees) and not servo.doubt
