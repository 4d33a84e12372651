"""The robot live in Foxglove, seen by a bare client of its protocol, and in a file by its reader.

Modules: servolink.gateways.foxglove.live_channels, servolink.twin.body, servolink.cli.recordings.foxglove_live.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
import signal
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import aiohttp
import pytest
from mcap.reader import make_reader

from servolink.client import connect
from servolink.recorder import CHANNELS, Event, RecordedServo, Recording, ServosRead
from tests.cli.programs import call, finished, started
from tests.extras import hide
from tests.gateways.robots import GUARD, RobotSeen, supervised_robot
from tests.recorder.files import write
from tests.twin.figures import DEMO, template

pytest.importorskip("foxglove", reason="in the extra foxglove")

import foxglove

from servolink.gateways.foxglove import live_server
from servolink.gateways.foxglove.live_channels import LiveChannels
from servolink.gateways.foxglove.live_server import MOVE, PublishedTargets, serving
from servolink.twin import Body

PROTOCOL = "foxglove.sdk.v1"
_DATA = 1  # opcode of messages, in both directions


class BareClient:
    """Program that speaks the protocol of Foxglove."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self.channels: dict[str, dict[str, Any]] = {}
        self.status: list[str] = []
        self.heard: dict[str, list[bytes]] = {}
        self._by_subscription: dict[int, str] = {}
        self._published = 0

    async def until(self, done: Callable[[], object]) -> None:
        """Read messages until something is so."""
        async with asyncio.timeout(GUARD):
            while not done():
                message = await self._socket.receive()
                assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
                if message.type == aiohttp.WSMsgType.TEXT:
                    self._take(json.loads(message.data))
                elif message.data[0] == _DATA:
                    subscription, _ = struct.unpack_from("<IQ", message.data, 1)
                    self.heard.setdefault(self._by_subscription[subscription], []).append(message.data[13:])

    def _take(self, value: dict[str, Any]) -> None:
        if value["op"] == "advertise":
            self.channels |= {each["topic"]: each for each in value["channels"]}
        elif value["op"] == "status":
            self.status.append(value["message"])

    def has_more_than(self, refusals: int) -> bool:
        return len(self.status) > refusals

    async def subscribe(self, *topics: str) -> None:
        """Listen to channels."""
        await self.until(lambda: set(topics) <= self.channels.keys())
        ids = {topic: self.channels[topic]["id"] for topic in topics}
        self._by_subscription |= {channel: topic for topic, channel in ids.items()}
        wanted = [{"id": channel, "channelId": channel} for channel in ids.values()]
        await self._socket.send_json({"op": "subscribe", "subscriptions": wanted})

    async def publish(self, target: Any, topic: str = MOVE) -> None:
        """Publish a target, or bytes as they are, on a channel of the client's own."""
        data = target if isinstance(target, bytes) else json.dumps(target).encode()
        self._published += 1
        channel = {"id": self._published, "topic": topic, "encoding": "json", "schemaName": ""}
        await self._socket.send_json({"op": "advertise", "channels": [channel]})
        await self._socket.send_bytes(struct.pack("<BI", _DATA, self._published) + data)


@asynccontextmanager
async def client_at(port: int) -> AsyncIterator[BareClient]:
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://127.0.0.1:{port}", protocols=[PROTOCOL]) as socket,
    ):
        yield BareClient(socket)


async def always(question: str) -> bool:
    """Answer with yes."""
    return True


@asynccontextmanager
async def live(
    ask: Callable[[str], Awaitable[bool]] = always, *, may_move: bool = True
) -> AsyncIterator[tuple[RobotSeen, int]]:
    """Serve a robot to Foxglove; yield the robot and the port."""
    async with asyncio.timeout(GUARD), supervised_robot() as (robot, supervisor):
        robot.motions.clear()
        context = foxglove.Context()
        channels = LiveChannels(context, template("humanoid-16"))
        listener = PublishedTargets(channels, supervisor if may_move else None, 60.0, ask)
        async with serving(listener, context, "127.0.0.1", 0, may_move=may_move) as port:
            following = asyncio.create_task(channels.follow_hub("rex"))
            try:
                yield robot, port
            finally:
                following.cancel()
                await asyncio.wait((following,))


def test_servos_joints_transforms_scene_and_events_are_live() -> None:
    async def main() -> None:
        async with live(may_move=False) as (robot, port), client_at(port) as client:
            await client.subscribe("/servos", "/joint_states", "/tf", "/scene", "/log", "/events")
            await client.until(lambda: client.heard.keys() >= {"/servos"})
            async with connect("share://rex") as board:
                await board.move({1: 30}, duration=0.05, wait=True)
            await client.until(lambda: b'"angle":30,' in (client.heard.get("/servos") or [b""])[-1])
            await client.until(lambda: {"/joint_states", "/tf", "/scene", "/log", "/events"} <= client.heard.keys())
            assert json.loads(client.channels["/servos"]["schema"])["properties"].keys() == {"servos", "missed"}
            assert client.channels["/tf"]["schemaName"] == "foxglove.FrameTransforms"
            assert b"r_shoulder" in client.heard["/tf"][-1]
            turned = struct.pack("<d", math.radians(30))
            await client.until(lambda: turned in client.heard["/joint_states"][-1])
            await robot.until(lambda: len(robot.motions) == 1)

    asyncio.run(main())


def test_published_targets_move_after_a_yes_and_only_then() -> None:
    answers = [True, False]
    questions: list[str] = []

    async def ask(question: str) -> bool:
        questions.append(question)
        return answers.pop(0)

    async def main() -> None:
        async with live(ask) as (robot, port), client_at(port) as client:
            await client.publish({"1": 20})
            await robot.until(lambda: len(robot.motions) == 1)
            assert questions == ["May the robot move servo 1 to 20 degrees? The motion lasts 0.3 s."]
            await robot.until(lambda: "done" in " ".join(robot.log))
            await client.publish({"1": 0})
            await client.until(lambda: client.status)
            assert "the person said no" in client.status[-1]
            wrongs = [{"1": angle} for angle in ("x", True, math.nan, math.inf, 10**400, 1e300)]
            for wrong in (*wrongs, {"99": 1}, [1], "x" * 100_000, b"[" * 60_000, b'{"1": 5, "1": 9}', b"\xff"):
                await client.publish(wrong)
                refusals = len(client.status)
                await client.until(partial(client.has_more_than, refusals))
            await client.publish({"1": 0}, topic="/elsewhere")
            assert len(robot.motions) == 1

    asyncio.run(main())


async def test_a_client_that_floods_fills_no_memory() -> None:
    listener, calls = PublishedTargets(cast("Any", None), None, 60.0, always), list[tuple[Any, ...]]()
    listener._loop = cast("Any", SimpleNamespace(call_soon_threadsafe=lambda *call: calls.append(call)))
    client = SimpleNamespace(id=1)
    for number in range(1000):
        for topic in (MOVE, f"/{number}"):
            listener.on_client_advertise(client, SimpleNamespace(id=number, topic=topic))
        listener.on_message_data(client, number, bytes(100_000))
    assert len(calls) == 1000 + live_server._MOST_WAITING
    for act, *arguments in calls:
        act(*arguments)
    assert len(listener._to_move) == live_server._MOST_CHANNELS
    calls.clear()
    listener.on_message_data(client, 0, b"{}")
    assert len(calls) == 1, "there is room again"


def test_the_end_of_a_client_stops_what_it_moved() -> None:
    async def main() -> None:
        async with live() as (robot, port):
            async with client_at(port) as client:
                await client.publish({"1": 170})
                await robot.until(lambda: bool(robot.motions))
            await robot.until(lambda: bool(robot.stops))
            assert (await robot.board.servo(1)).angle < 90

    asyncio.run(main())


def test_messages_of_any_time_are_shown(tmp_path: Path) -> None:
    context = foxglove.Context()
    channels = LiveChannels(context, template("humanoid-16"))
    state = RecordedServo(1, 90.0, "degree", 5, 300, 1, is_start=True, is_hold=True)
    with foxglove.open_mcap(tmp_path / "out.mcap", context=context):
        for message in (ServosRead((state,)), Event("mark", "mark", text="here")):
            for time in (0, 2**64 - 1):
                channels.take(time, message)
    with (tmp_path / "out.mcap").open("rb") as file:
        found = [(channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()]
    for topic in ("/joint_states", "/tf", "/log"):
        assert {time for each, time in found if each == topic} == {0, 2**64 - 1}


def test_without_permission_nobody_can_publish() -> None:
    async def main() -> None:
        async with live(may_move=False) as (robot, port), client_at(port) as client:
            await client.publish({"1": 20})
            await client.until(lambda: client.status)  # the server has no such capability
            assert robot.motions == []

    asyncio.run(main())


def test_a_pose_keeps_the_lower_foot_flat() -> None:
    body = Body.of(template("humanoid-16"))
    at = next(number for number, part in enumerate(body.parts) if part.name in body.feet)
    rest, bow = body.posed({}), body.posed(dict.fromkeys(range(7, 17), 20))
    feet = [number for number, part in enumerate(body.parts) if part.name in body.feet]
    kept = [number for number in feet if max(map(abs, map(float.__sub__, bow[number].z, rest[number].z))) < 1e-9]
    assert kept
    assert rest[at].at[2] > 0
    assert bow[feet[0]].at != bow[feet[1]].at


def test_a_recording_is_shown_and_written_with_all_channels(tmp_path: Path) -> None:
    state = RecordedServo(1, 90.0, "degree", 5, 300, 1, is_start=True, is_hold=True)
    recording = write(tmp_path / "in.mcap", [(0.0, ServosRead((state,))), (1.0, Event("mark", "mark", text="here"))])
    words = ("--recording", str(recording), "--project", str(DEMO), "--mcap", str(tmp_path / "out.mcap"))
    serving = started("foxglove", *words, "--listen", "127.0.0.1:0", "--json")
    assert serving.stdout is not None
    port = int(json.loads(serving.stdout.readline())["foxglove"].rpartition(":")[2])

    async def main() -> None:
        async with client_at(port) as client:
            await client.subscribe("/log", "/scene")
            await client.until(lambda: client.heard.keys() >= {"/log", "/scene"})

    asyncio.run(main())
    said = finished(serving, signal.SIGINT)
    assert said.code == 0, said.err
    with (tmp_path / "out.mcap").open("rb") as file:
        found = [(channel.topic, schema.name) for schema, channel, _ in make_reader(file).iter_messages() if schema]
    assert ("/joint_states", "foxglove.JointStates") in found
    assert {"/servos", "/events", "/tf", "/scene", "/log"} <= {topic for topic, _ in found}
    assert {topic for topic, name in found if name.startswith("servolink.")} <= CHANNELS.keys()


@pytest.mark.parametrize("figure", [True, False])
def test_a_recording_is_converted_with_the_same_channels(
    tmp_path: Path, figure: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    state = RecordedServo(1, 90.0, "degree", 5, 300, 1, is_start=True, is_hold=True, caption="hip\udce5")
    recording = write(
        tmp_path / "in.mcap", [(0.0, ServosRead((state,))), (1.0, Event("mark", "mark", text="no\udce6"))]
    )
    words = ("convert", str(recording), "--foxglove", *(("--project", str(DEMO)) if figure else ()))
    out = tmp_path / "in.foxglove.mcap"
    assert call(capsys, *words).out == f"{out}  2 messages\n"
    with out.open("rb") as file:
        found = [(channel.topic, message.log_time) for _, channel, message in make_reader(file).iter_messages()]
    expected = {"/servos", "/joint_states", "/events", "/log", *(("/tf", "/scene") if figure else ())}
    assert {topic for topic, _ in found} == expected
    assert {time for _, time in found} == {entry.time for entry in Recording(recording).entries()}
    assert "cannot be written" in call(capsys, *words).err
    assert call(capsys, *words, "--force").code == 0
    assert "would be lost" in call(capsys, *words, "-o", str(recording), "--force").err
    assert "--foxglove" in call(capsys, "convert", str(recording), "--csv", "--project", str(DEMO)).err


async def test_a_recording_keeps_its_pace_and_long_silences_are_cut(tmp_path: Path) -> None:
    file = write(tmp_path / "in.mcap", [(at, Event("mark", "mark", text=str(at))) for at in (0.0, 0.5, 100.0)])
    taken: list[float] = []
    loop = asyncio.get_running_loop()

    class Channels(LiveChannels):
        def take(self, time: int, message: Any) -> None:
            taken.append(loop.time())

    await Channels(foxglove.Context(), None).follow_recording(Recording(file), 2.0)
    assert [round(at - taken[0], 2) for at in taken] == [0.0, 0.25, 1.25]


def test_wrong_usage_and_a_missing_extra_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert "needs a terminal" in call(capsys, "foxglove", "--allow-motion").err
    assert "has none" in call(capsys, "foxglove", "--allow-motion", "--recording", "x.mcap").err
    with pytest.MonkeyPatch.context() as patch:
        hide("foxglove", "servolink.gateways.foxglove", patch)
        found = call(capsys, "foxglove", "--board", "virtual://")
    assert found.code == 1
    assert re.search(r"pip install '\.\[foxglove\]'", found.err)
