"""Channels for Foxglove: those of a recording, and joints, transforms, scene and log in Foxglove's own schemas."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import foxglove  # pyright: ignore[reportMissingImports]
from foxglove import channels, messages  # pyright: ignore[reportMissingImports]

from servolink import recorder
from servolink.errors import RecordingError
from servolink.project import Figure
from servolink.recorder import (
    CommandDone,
    Entry,
    Event,
    Message,
    ProblemFound,
    ReadingsFeed,
    Recording,
    ServosRead,
    is_problem,
    tapping,
)
from servolink.twin import Body, BodyPart, Placement, Solid, Vector

WORLD: Final = "world"
"""Frame of the floor below the robot: x points forward, y to the robot's left, z up."""
JOINTS, TRANSFORMS, SCENE, LOG = "/joint_states", "/tf", "/scene", "/log"

_LAST = 0xFFFF_FFFF  # seconds since 1970 that a time stamp holds; a recording may have any
_LONGEST_PAUSE = 1.0  # seconds between two messages of a recording; longer silences are cut short
HZ: Final = 25.0
"""Readings of the servos per second."""
_RECORDED = ("/servos", "/events", "/commands", "/problems")
_TONES = {
    "shell": (0.84, 0.86, 0.89),
    "limb": (0.37, 0.54, 0.78),
    "dark": (0.27, 0.3, 0.34),
    "glow": (0.94, 0.69, 0.25),
}


class LiveChannels:
    """Channels of one robot; messages with their times in, messages for Foxglove out."""

    def __init__(self, context: Any, figure: Figure | None) -> None:
        """Log to all sinks of a Foxglove context. Raise TwinError for a figure without a possible body."""
        self._body: Body | None = None if figure is None else Body.of(figure)
        self._recorded = {
            topic: foxglove.Channel(topic, message_encoding="json", schema=_schema(topic), context=context)
            for topic in _RECORDED
        }
        self._joints = channels.JointStatesChannel(JOINTS, context=context)
        self._log = channels.LogChannel(LOG, context=context)
        if self._body is not None:
            self._transforms = channels.FrameTransformsChannel(TRANSFORMS, context=context)
            self._scene = channels.SceneUpdateChannel(SCENE, context=context)

    def take(self, time: int, message: Message) -> None:
        """Log a message of a recording or of a hub, at `time` (nanoseconds since 1970)."""
        topic = recorder.TOPICS[type(message)]
        if topic not in self._recorded:
            return
        self._recorded[topic].log(recorder.encode(message), log_time=time)
        if isinstance(message, ServosRead):
            self._take_servos(time, message)
        else:
            self._take_line(time, message)

    def draw_scene(self, time: int) -> None:
        """Log the shapes of all parts, for programs that begin to listen; without a figure there are none."""
        if self._body is not None:
            parts = self._body.parts
            self._scene.log(
                messages.SceneUpdate(entities=[_entity(part) for part in parts if part.solids]), log_time=time
            )

    def _take_servos(self, time: int, reading: ServosRead) -> None:
        """Log joints and transforms; servos that are set to ADC have no angle in degrees."""
        angles = {servo.servo_id: servo.angle for servo in reading.servos if servo.angle_unit != "adc"}
        parts = () if self._body is None else self._body.parts
        names = {part.servo: part.name for part in reversed(parts) if part.servo is not None}
        joints = [
            messages.JointState(name=names.get(servo_id, f"servo {servo_id}"), position=math.radians(angle))
            for servo_id, angle in angles.items()
        ]
        stamp = _stamp(time)
        self._joints.log(messages.JointStates(timestamp=stamp, joints=joints), log_time=time)
        if self._body is not None:
            places = zip(parts, self._body.posed(angles), strict=True)
            moved = [_transform(stamp, part, place) for part, place in places]
            self._transforms.log(messages.FrameTransforms(transforms=moved), log_time=time)

    def _take_line(self, time: int, message: Message) -> None:
        """Log an event, a problem or a failed command as a line for people."""
        level = messages.LogLevel.Warning if is_problem(message) else messages.LogLevel.Info
        match message:
            case Event():
                text = f"{message.kind} {message.what} {message.text or message.who}".rstrip()
            case ProblemFound():
                text = f"{message.kind}: {message.text}"
            case CommandDone() if is_problem(message):
                text = f"{message.packet} {message.outcome}: {message.reason}"
            case _:
                return
        self._log.log(messages.Log(timestamp=_stamp(time), level=level, message=text, name="servolink"), log_time=time)

    async def follow_hub(self, hub: str) -> None:
        """Log all that a hub tells, until the hub ends. Raise OpenError without such a hub."""
        loop = asyncio.get_running_loop()

        def take(seconds: float, message: Any) -> None:
            self.take(time.time_ns() - round((loop.time() - seconds) * 1e9), message)

        async with tapping(hub) as source:
            await source.begin(take, ReadingsFeed(take, HZ))
            await source.ended.wait()

    async def follow_recording(self, recording: Recording, speed: float) -> None:
        """Log the messages of a recording with their own times, at `speed` times its pace, once."""
        loop = asyncio.get_running_loop()
        due, before = loop.time(), 0.0
        for entry in recording.entries():
            due += min((entry.seconds - before) / speed, _LONGEST_PAUSE)
            before = entry.seconds
            if (pause := due - loop.time()) > 0:
                await asyncio.sleep(pause)
            self.take(entry.time, entry.message)


def written_to(path: Path, context: Any, *, replace: bool = False) -> Any:
    """Return a writer of all channels of a context to a file. Raise RecordingError if it cannot be written."""
    try:
        return foxglove.open_mcap(path, context=context, allow_overwrite=replace)
    except (OSError, RuntimeError) as error:
        raise RecordingError(f"{path}: cannot be written: {error}; give the name of a new file") from error


def convert(entries: Iterable[Entry[Message]], figure: Figure | None, path: Path, *, replace: bool = False) -> int:
    """Write messages of a recording to a file with all channels, and return how many there were.

    Raise RecordingError if the file cannot be written, and TwinError as `LiveChannels` does.
    """
    context, count = foxglove.Context(), 0
    live = LiveChannels(context, figure)
    with written_to(path, context, replace=replace):
        for count, entry in enumerate(entries, 1):
            if count == 1:
                live.draw_scene(entry.time)
            live.take(entry.time, entry.message)
    return count


def _schema(topic: str) -> Any:
    name, encoding = recorder.SCHEMA_NAMES[topic], recorder.SCHEMA_ENCODING
    return foxglove.Schema(name=name, encoding=encoding, data=recorder.schema(topic))


def _stamp(time: int) -> Any:
    seconds, rest = divmod(time, 10**9)
    return messages.Timestamp(min(seconds, _LAST), rest)


def _transform(stamp: Any, part: BodyPart, place: Placement) -> Any:
    """Return the position of a part in the world."""
    return messages.FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=part.name,
        translation=_vector(place.at),
        rotation=_quaternion(place),
    )


def _quaternion(place: Placement) -> Any:
    """Return the rotation of a frame; the largest component is computed first, which avoids a division by 0."""
    rows = list(zip(place.x, place.y, place.z, strict=True))
    trace = rows[0][0] + rows[1][1] + rows[2][2]
    squares = (1 + trace, *(1 - trace + 2 * rows[at][at] for at in range(3)))
    largest = max(range(4), key=squares.__getitem__)
    twice = math.sqrt(squares[largest])
    if largest == 0:
        found = [twice, *(rows[(at + 2) % 3][(at + 1) % 3] - rows[(at + 1) % 3][(at + 2) % 3] for at in range(3))]
    else:
        at = largest - 1
        one, other = (at + 1) % 3, (at + 2) % 3
        found = [rows[other][one] - rows[one][other], 0.0, 0.0, 0.0]
        found[1 + at], found[1 + one], found[1 + other] = (
            twice,
            rows[one][at] + rows[at][one],
            rows[other][at] + rows[at][other],
        )
    w, x, y, z = (0.5 * value if number == largest else 0.5 * value / twice for number, value in enumerate(found))
    return messages.Quaternion(x=x, y=y, z=z, w=w)


def _entity(part: BodyPart) -> Any:
    """Return the shapes of a part, in the frame of the part."""
    cubes = [_cube(solid) for solid in part.solids if solid.axis is None]
    cylinders = [_cylinder(solid, solid.axis) for solid in part.solids if solid.axis is not None]
    return messages.SceneEntity(frame_id=part.name, id=part.name, frame_locked=True, cubes=cubes, cylinders=cylinders)


def _cube(solid: Solid) -> Any:
    size = messages.Vector3(x=2 * solid.half[0], y=2 * solid.half[1], z=2 * solid.half[2])
    return messages.CubePrimitive(pose=_pose(solid, Placement()), size=size, color=_colour(solid))


def _cylinder(solid: Solid, axis: int) -> Any:
    """Return a cylinder, which Foxglove draws along z, turned to the axis."""
    turned = (Placement((0, 0, -1), (0, 1, 0), (1, 0, 0)), Placement((1, 0, 0), (0, 0, -1), (0, 1, 0)), Placement())[
        axis
    ]
    across, length = solid.half[(axis + 1) % 3], solid.half[axis]
    size = messages.Vector3(x=2 * across, y=2 * across, z=2 * length)
    pose, colour = _pose(solid, turned), _colour(solid)
    return messages.CylinderPrimitive(pose=pose, size=size, bottom_scale=1, top_scale=1, color=colour)


def _pose(solid: Solid, turned: Placement) -> Any:
    return messages.Pose(position=_vector(solid.at), orientation=_quaternion(turned))


def _vector(vector: Vector) -> Any:
    return messages.Vector3(x=vector[0], y=vector[1], z=vector[2])


def _colour(solid: Solid) -> Any:
    red, green, blue = _TONES[solid.tone]
    return messages.Color(r=red, g=green, b=blue, a=1.0)
