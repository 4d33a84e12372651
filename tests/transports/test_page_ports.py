"""Ports of a page: STOP in the page, frames of epochs, and ports that come and go."""

from __future__ import annotations

import asyncio
import json

import pytest

from servolink.errors import InvalidAddress, OpenError, TransportUnavailable
from servolink.transports.page_ports import PagePort, PagePorts, candidates
from servolink.transports.registry import create
from tests.transports.wires import Ear, PageWire, PlainFrames


async def test_a_port_is_opened_with_its_options_and_the_frame_that_stops() -> None:
    async with PageWire() as wire:
        wire.transport = PagePort("webserial://1a86:7523/2?byte_order=big", wire._page, {"baudrate": 9600})
        await wire.open()
        (opened, options), stop = wire.posted
        assert (opened, json.loads(options)) == ("port.open", {"url": "webserial://1a86:7523/2", "baudrate": 9600})
        assert stop == ("port.stop", "S")


async def test_frames_carry_the_epoch_and_whether_they_may_move() -> None:
    async with PageWire() as wire:
        await wire.open()
        await wire.transport.send(b"M\xff")
        await wire.transport.send(b"q")
        assert wire.posted[2:] == [("port.frame", "0! M\xff"), ("port.frame", "0 q")]


async def test_the_stop_of_the_connection_is_not_sent_again_and_begins_the_new_epoch() -> None:
    async with PageWire() as wire:
        await wire.open()
        stopped: list[int] = []
        wire._page.on_stop = lambda: stopped.append(1)
        wire.tell("port.stopped", "1")
        await asyncio.sleep(0)
        assert (stopped, wire._page.stops_behind) == ([1], 1)
        await wire.transport.send(b"M1")  # asked for before the stop
        await wire.transport.send(b"S")
        await wire.transport.send(b"M2")
        await wire.transport.send(b"S")  # a stop of the program
        assert [text for kind, text in wire.posted if kind == "port.frame"] == ["0! M1", "1! M2", "1 S"]
        assert wire._page.stops_behind == 0


async def test_each_of_several_stops_of_the_page_is_followed_by_one_of_the_connection() -> None:
    async with PageWire() as wire:
        ear = await wire.open()
        wire.tell("port.stopped", "1")
        wire.tell("port.stopped", "2")
        await wire.say(b"two responses")
        await asyncio.sleep(0)
        await wire.transport.send(b"S")
        await wire.transport.send(b"M1")  # older than the second stop: the page drops it
        await asyncio.sleep(0)
        assert (ear.heard, wire._page.stops_behind) == (b"", 1)
        await wire.transport.send(b"S")
        await wire.transport.send(b"M2")
        assert [text for kind, text in wire.posted if kind == "port.frame"] == ["1! M1", "2! M2"]
        assert await ear.hear(13) == b"two responses"


async def test_responses_wait_until_the_connection_has_sent_its_stop() -> None:
    async with PageWire() as wire:
        ear = await wire.open()
        wire.tell("port.stopped", "1")
        await wire.say(b"response")
        await asyncio.sleep(0)
        assert ear.heard == b""
        await wire.transport.send(b"S")
        assert await ear.hear(8) == b"response"


async def test_responses_wait_for_one_second_at_most() -> None:
    async with PageWire() as wire:
        ear = await wire.open()
        begun = asyncio.get_running_loop().time()
        wire.tell("port.stopped", "1")
        await wire.say(b"response")
        assert await ear.hear(8) == b"response"
        assert asyncio.get_running_loop().time() - begun == pytest.approx(1, abs=0.01)
        await wire.transport.send(b"M")
        assert wire.posted[-1] == ("port.frame", "0! M")  # still of the old epoch, which the page drops


async def test_a_port_that_the_page_cannot_open_says_why() -> None:
    async with PageWire() as wire:
        opening = asyncio.ensure_future(wire.transport.open(Ear()))
        while not wire.posted:
            await asyncio.sleep(0)
        wire._page.take("port.failed", wire._number, "other tab")
        with pytest.raises(OpenError, match="another tab of this browser has the robot; close that tab"):
            await opening


async def test_an_opening_that_is_cancelled_closes_the_port() -> None:
    async with PageWire() as wire:
        wire._page.post = lambda kind, number, text: wire.posted.append((kind, text))
        opening = asyncio.ensure_future(wire.transport.open(Ear()))
        await asyncio.sleep(0)
        opening.cancel()
        await asyncio.wait([opening])
        assert [kind for kind, _ in wire.posted] == ["port.open", "port.stop", "port.close"]


async def test_granted_ports_are_found_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    page = PagePorts(lambda kind, number, text: None, PlainFrames(), lambda: None)
    monkeypatch.setattr(PagePorts, "here", page)
    page.take("port.list", 0, json.dumps([{"url": "webserial://1a86:7523/2", "product": "CH340"}]))
    (found,) = candidates()
    assert (found.url, found.product, found.identity.vendor_id, found.serial_number) == (
        "webserial://1a86:7523/2",
        "CH340",
        0x1A86,
        "",
    )
    assert isinstance(create(found.url), PagePort)
    with pytest.raises(InvalidAddress, match="VID:PID"):
        create("webserial://nothing")


def test_outside_a_browser_the_address_says_where_it_belongs() -> None:
    assert candidates() == []
    with pytest.raises(TransportUnavailable, match="for the page in a browser"):
        create("webserial://1a86:7523")
