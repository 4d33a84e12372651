"""What a hub tells programs through its control interface without being asked each time."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

import pytest

from servolink.client import connect
from servolink.control import ProblemNotice, Role
from servolink.hub.hub import share
from servolink.virtual import VirtualBoard
from tests.client.piped_board import now
from tests.client.sockets import Socket
from tests.hub.control_program import RpcFailed, Shared, shared
from tests.hub.local_transport import LocalTransport
from tests.plugged import plugged


async def test_watchers_get_the_latest_and_no_more_than_they_acknowledge() -> None:
    async with shared() as here, here.program("page") as page, here.program("other") as other:
        assert await page.call("servos.watch", hz=50) == {"hz": 50, "credit": 2}
        await asyncio.sleep(1)
        assert [frame["number"] for frame in page.of("servos")] == [1, 2]
        await other.call("move", targets={"1": 60}, duration=0.1, wait=True)
        page.tell("servos.ack", number=2)
        await page.until("servos", 4)
        frames = page.of("servos")
        assert frames[3]["servos"][0]["angle"] == 60
        assert frames[2]["missed"] > 10
        page.tell("servos.ack", number=99)
        await page.until("servos", 6)
        await page.call("servos.unwatch")
        count = len(page.of("servos"))
        page.tell("servos.ack", number=count)
        await asyncio.sleep(1)
        assert len(page.of("servos")) == count


async def test_the_board_is_not_read_for_a_watcher_that_is_frozen() -> None:
    async with shared() as here, here.program("page") as page:
        await page.call("servos.watch", hz=50)
        await asyncio.sleep(3)
        received = here.hub.board.stats.frames_received
        await asyncio.sleep(5)
        assert here.hub.board.stats.frames_received - received < 5
        page.tell("servos.ack", number=2)
        await page.until("servos", 4)


async def test_only_what_has_changed_is_sent_if_that_is_enough() -> None:
    async with shared() as here, here.program("page") as page:
        await page.call("servos.watch", hz=10, changed_only=True)
        assert len((await page.until("servos", 1))["servos"]) == 3
        assert (await page.until("servos", 2))["servos"] == []
        await page.call("move", targets={"2": 60}, duration=0.1, wait=True)
        page.tell("servos.ack", number=2)
        frame = await page.until("servos", 3)
        page.tell("servos.ack", number=3)
        frame = await page.until("servos", 4)
        assert {one["servo_id"] for one in [*page.of("servos")[2]["servos"], *frame["servos"]]} == {2}


async def test_all_watchers_share_one_poll() -> None:
    async with shared() as here, AsyncExitStack() as stack:
        pages = [await stack.enter_async_context(here.program(f"page {number}")) for number in range(20)]
        for page in pages:
            await page.call("servos.watch", hz=50)
        sent = here.hub.board.stats.frames_received
        for _ in range(50):
            await asyncio.sleep(0.02)
            for page in pages:
                page.tell("servos.ack", number=len(page.of("servos")))
        assert here.hub.board.stats.frames_received - sent < 60
        assert min(len(page.of("servos")) for page in pages) > 40


async def test_button_events_come_to_those_who_subscribe() -> None:
    async with shared() as here, here.program("page") as page, here.program("other") as other:
        await other.call("status")
        await page.call("buttons.subscribe")
        here.virtual.press_button(4, now())
        assert await page.until("button") == {"button_id": 4, "event": 1, "kind": "press"}
        await page.call("buttons.unsubscribe")
        await asyncio.sleep(0.1)
        here.virtual.press_button(5, now())
        await asyncio.sleep(0.5)
        assert [event["button_id"] for event in page.of("button")] == [4]
        assert other.of("button") == []


async def test_watching_goes_on_when_the_board_answers_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async with shared(patience=10) as here, here.program("page") as page:
        await page.call("servos.watch", hz=10)
        await page.until("servos")
        (line,) = here.virtual.sessions
        monkeypatch.setattr(line, "receive", lambda data, now: None)
        with pytest.raises(RpcFailed) as failed:
            await page.call("buttons.subscribe")
        assert failed.value.kind in {"RequestTimeout", "OutcomeUnknown"}
        count = len(page.of("servos"))
        page.tell("servos.ack", number=count)
        monkeypatch.undo()
        await page.until("servos", count + 1)
        assert page.of("problem") == []


async def test_an_error_of_watching_is_said_once() -> None:
    async with shared(servos=0) as here, here.program("page") as page:
        await page.call("servos.watch", hz=10)
        await page.until("problem")
        await asyncio.sleep(10)
        assert len(page.of("problem")) == 1


async def test_the_end_of_the_hub_ends_watching() -> None:
    async with shared() as here, here.program("page") as page:
        await page.call("servos.watch", hz=10)
        await page.call("buttons.subscribe")
        await here.hub.close()
        await asyncio.sleep(1)
        assert page.channel._servos._task is not None
        assert page.channel._servos._task.done()
        with pytest.raises(RpcFailed) as failed:
            await page.call("servos.list")
        assert failed.value.kind == "ConnectionLost"


async def test_a_program_that_reads_too_slowly_is_told_what_it_missed() -> None:
    async with shared() as here, here.program("page") as page:
        await page.call("board.state")
        page.channel.pause()
        for _ in range(300):
            here.hub.tell(ProblemNotice("trouble"))
        page.channel.resume()
        assert len(page.of("problem")) == 257
        assert page.of("problem")[-1]["text"] == "this program reads too slowly: 44 notifications were dropped"
        await page.call("servos.watch", hz=10)
        page.channel.pause()
        await asyncio.sleep(10)
        page.channel.resume()
        await page.until("servos", 2)
        assert len(page.of("problem")) == 257


async def test_a_packet_that_the_hub_refuses_is_reported_to_its_program_alone() -> None:
    async with (
        shared() as here,
        connect(LocalTransport(here.hub, session_id="s", who="script", role=Role.WATCH)) as board,
        here.program("script", session="s") as script,
        here.program("page") as page,
    ):
        await script.call("board.state")
        await page.call("board.state")
        await board.move({1: 10}, duration=1)
        assert (await script.until("refused"))["packet"] == "ExecuteActionRequest"
        assert page.of("refused") == []


async def test_who_did_not_ask_for_programs_is_not_told_of_them() -> None:
    async with shared() as here, here.program("script") as script:
        nobody: dict[str, object] = {"state": "connected", "lease": None, "hold": None, "another": "", "unanswered": []}
        assert await script.call("board.state") == nobody
        async with here.program("studio") as studio:
            await studio.call("lease.take")
        assert script.of("program") == []
        assert [change["event"] for change in script.of("lease")] == ["taken", "left"]


async def test_the_connection_to_the_board_is_reported() -> None:
    async with shared() as here, here.program("page") as page:
        await page.call("status")
        here.hub.board.connection.transport.unplug()  # type: ignore[attr-defined]
        assert (await page.until("connection"))["state"] == "lost"


async def test_another_board_in_place_of_the_one_that_was_lost_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, other = VirtualBoard(), VirtualBoard()
    ours.storage.project_id, other.storage.project_id = 5, 77
    socket = Socket(ours)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as board,
        share(board, name="rex") as hub,
        Shared(hub, ours).program("page") as page,
    ):
        await page.call("status")
        said = f"the board at {url} has project id 77, not 5, so it is another one"
        socket.pull()
        socket.plug(other)
        assert await page.until("connection", 2) == {"state": "lost", "another": said}
        assert (await page.call("status"))["another"] == (await page.call("board.state"))["another"] == said
        socket.board = None
        assert await page.until("connection", 3) == {"state": "lost", "another": ""}
        socket.plug(other)
        assert await page.until("connection", 4) == {"state": "lost", "another": said}
        socket.plug(ours)
        assert await page.until("connection", 5) == {"state": "connected", "another": ""}
        assert (await page.call("status"))["another"] == ""
        assert len(page.of("connection")) == 5
