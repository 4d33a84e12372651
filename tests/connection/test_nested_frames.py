"""Frames inside frames: what hides in a caption is neither an answer nor an event, whatever the line is like."""

from __future__ import annotations

import asyncio

import pytest

from servolink.connection.dispatcher import NestedFrameFilter
from servolink.errors import RequestTimeout
from servolink.protocol import (
    HEADER,
    MAGIC,
    ButtonEventResponse,
    ByteOrder,
    Codec,
    Frame,
    Packet,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    encode_frame,
)
from tests.client.piped_board import SWALLOWED, PipedBoard, connected

EVENT = ButtonEventResponse(9, 1)
PROJECT = QueryProjectIDResponse(666)
OTHER = ButtonEventResponse(1, 4)


def frame_of(packet: Packet, byte_order: ByteOrder = "little") -> Frame:
    return packet.packet_id, Codec(byte_order).encode(packet)[8:-1]


def hostile_list(*hidden: bytes, byte_order: ByteOrder = "little") -> bytes:
    """Return the frame of a list of actions, each of whose captions is one of these."""
    entries = b"".join(bytes(4) + caption.ljust(32, b"\0") for caption in hidden)
    return encode_frame(30011, len(hidden).to_bytes(2, byte_order) + entries, byte_order)


def list_with(*hidden: bytes) -> Frame:
    return 30011, hostile_list(*hidden)[8:-1]


def hidden(packet: Packet) -> bytes:
    return Codec().encode(packet)


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_frames_inside_a_frame_are_hidden_each_as_often_as_it_is_there(byte_order: ByteOrder) -> None:
    codec, nested = Codec(byte_order), NestedFrameFilter(byte_order)
    event, project = codec.encode(EVENT), codec.encode(PROJECT)
    outer = 30011, hostile_list(event, project, event, byte_order=byte_order)[8:-1]
    frames = [outer, *(frame_of(packet, byte_order) for packet in (EVENT, PROJECT, EVENT, EVENT, OTHER))]
    assert [nested.hides(frame) for frame in frames] == [False, True, True, True, False, False]


def test_what_comes_after_another_frame_is_not_hidden() -> None:
    nested = NestedFrameFilter("little")
    frames = [list_with(hidden(EVENT)), frame_of(OTHER), frame_of(EVENT)]
    assert [nested.hides(frame) for frame in frames] == [False, False, False]


def test_a_frame_that_begins_inside_and_reaches_out_is_hidden() -> None:
    nested = NestedFrameFilter("little")
    last = HEADER["little"].pack(MAGIC, 30011, 2 + 36) + b"\1\0"
    outer = hostile_list(bytes(32 - len(last)) + last)
    reaching = 30011, b"\1\0" + outer[-1:] + bytes(35)
    assert not nested.hides((30011, outer[8:-1]))
    assert nested.hides(reaching)
    assert not nested.hides(reaching)


def test_a_second_beginning_counts_where_the_first_leads_nowhere() -> None:
    nested = NestedFrameFilter("little")
    assert not nested.hides(list_with(MAGIC, hidden(EVENT)))
    assert nested.hides(frame_of(EVENT))


def test_a_frame_with_others_inside_takes_the_place_of_the_one_before() -> None:
    nested = NestedFrameFilter("little")
    frames = [list_with(hidden(EVENT)), list_with(hidden(PROJECT)), frame_of(EVENT)]
    assert [nested.hides(frame) for frame in frames] == [False, False, False]


@pytest.mark.parametrize("before", [b"", b"noise"])
@pytest.mark.parametrize("behind", [b"", bytes(50), b"noise", MAGIC + b"noise"])
async def test_no_event_comes_out_of_a_caption(before: bytes, behind: bytes) -> None:
    board = PipedBoard()
    board.plan(QueryActionListRequest, SWALLOWED)
    async with connected(board) as connection:
        events: list[ButtonEventResponse] = []
        connection.answers.on_event = events.append
        asking = asyncio.create_task(connection.request(QueryActionListRequest()))
        await asyncio.sleep(0.01)
        board.deliver(before + hostile_list(hidden(EVENT), hidden(EVENT)) + behind)
        answer = await asking
        assert isinstance(answer, QueryActionListResponse)
        assert len(answer.actions) == 2
        board.speak(OTHER)
        await asyncio.sleep(3)
        assert events == [OTHER]
        assert connection.stats.hidden == (2 if before or behind == b"noise" else 0)


async def test_no_answer_comes_out_of_a_caption() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board, depth=2, patience=0.2) as connection:
        listing = asyncio.create_task(connection.request(QueryActionListRequest()))
        asking = asyncio.create_task(connection.request(QueryProjectIDRequest()))
        await asyncio.sleep(0.01)
        board.deliver(b"noise" + hostile_list(hidden(PROJECT)))
        assert len((await listing).actions) == 1
        with pytest.raises(RequestTimeout):
            await asking
        assert connection.stats.hidden == 1
