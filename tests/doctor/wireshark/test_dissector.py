"""The dissector in tshark: what our encoder writes is what it shows."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from servolink.doctor.wireshark.dissector import ENCODINGS
from servolink.protocol import (
    PACKETS,
    AddActionRequest,
    AddActionResponse,
    ButtonEventResponse,
    ByteOrder,
    Codec,
    Packet,
    QueryActionRequest,
    QueryActionResponse,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryServoListRequest,
    QueryServoRequest,
    QueryServoResponse,
    Response,
    SendDummyDataRequest,
    Step,
    encode_frame,
)
from servolink.recorder import Captured
from tests.doctor.wireshark.drawn import ALPHABETS, drawn, shown
from tests.doctor.wireshark.tshark import Frame, Preferences, conversation, lines, with_tshark

pytestmark = with_tshark

SEED = int(os.environ.get("SERVOLINK_SEED", "0"))
LITTLE = Codec("little")


def line(frames: Sequence[tuple[Packet, bytes]], step: int = 1_000_000) -> list[Captured]:
    """Return frames on a line, a millisecond apart."""
    return [
        Captured(at * step, "received" if isinstance(packet, Response) else "sent", frame)
        for at, (packet, frame) in enumerate(frames)
    ]


def all_packets(random: Random, encoding: str) -> list[tuple[Packet, Codec]]:
    """Return some packets of each class in both byte orders."""
    codecs: list[Codec] = [Codec("little", encoding), Codec("big", encoding)]
    return [
        (drawn(declared, random, encoding), codec)
        for codec in codecs
        for _, declared in sorted(PACKETS.items())
        for _ in range(5)
    ]


def test_every_field_of_every_packet_in_both_byte_orders(tmp_path: Path) -> None:
    packets = all_packets(Random(SEED), "utf-8")
    found = lines(line([(packet, codec.encode(packet)) for packet, codec in packets]), tmp_path)
    assert len(found) == len(packets) == 600
    for at, (frame, (packet, codec)) in enumerate(zip(found, packets, strict=True), 1):
        assert frame.number == at
        assert frame.get("packet") == type(packet).__name__
        assert frame.get("packet_id") == str(packet.packet_id)
        assert frame.get("section") == packet.section
        assert frame.get("byte_order") == codec.byte_order
        assert frame.get("checksum.status") == "good"
        assert frame.content == shown(packet, codec), (at, packet)
        assert frame.experts <= {"unanswered", "failed"}


@pytest.mark.parametrize("encoding", ENCODINGS[1:])
def test_captions_in_every_encoding(encoding: str, tmp_path: Path) -> None:
    random, codec = Random(SEED), Codec("little", encoding)
    packets = [drawn(AddActionRequest, random, encoding) for _ in range(60)]
    found = lines(
        line([(packet, codec.encode(packet)) for packet in packets]), tmp_path, Preferences(encoding=encoding)
    )
    assert [frame.content for frame in found] == [shown(packet, codec) for packet in packets]
    assert set(ALPHABETS) == set(ENCODINGS)


def test_all_characters_of_big5(tmp_path: Path) -> None:
    characters = [
        text
        for lead in range(0xA1, 0xFA)
        for trail in range(0x40, 0xFF)
        if len(text := bytes((lead, trail)).decode("big5", "ignore")) == 1 and len(text.encode("big5")) == 2
    ]
    codec = Codec("little", "big5")
    texts = ["".join(characters[at : at + 15]) for at in range(0, len(characters), 15)]
    packets = [AddActionRequest(at, text) for at, text in enumerate(texts)]
    found = lines(line([(packet, codec.encode(packet)) for packet in packets]), tmp_path, Preferences(encoding="big5"))
    expected = [dict(shown(packet, codec))["action_caption"] for packet in packets]
    assert [frame.get("action_caption") for frame in found] == expected
    assert len(characters) > 13_000


def test_a_fixed_byte_order_reads_no_other(tmp_path: Path) -> None:
    frames = line([(QueryServoRequest(7), Codec(order).encode(QueryServoRequest(7))) for order in ("little", "big")])
    assert [frame.get("servo_id") for frame in lines(frames, tmp_path, Preferences("big"))] == [None, "7"]


def pieces(data: bytes, random: Random) -> Iterator[bytes]:
    """Yield `data` cut anywhere."""
    cuts = [0, *sorted(random.sample(range(1, len(data)), min(len(data) - 1, len(data) // 15))), len(data)]
    yield from (data[start:end] for start, end in pairwise(cuts))


@pytest.mark.parametrize("is_tcp", [True, False], ids=["tcp", "line"])
def test_frames_that_are_cut_and_joined(is_tcp: bool, tmp_path: Path) -> None:
    random = Random(SEED)
    streams: dict[bool, list[Packet]] = {True: [], False: []}
    for _, declared in sorted(PACKETS.items()):
        streams[not issubclass(declared, Response)] += [drawn(declared, random), drawn(declared, random)]
    streams[True].append(SendDummyDataRequest(random.randbytes(3_000)))  # longer than any segment
    waiting = {
        is_host: list(pieces(b"".join(map(LITTLE.encode, packets)), random)) for is_host, packets in streams.items()
    }
    turns = [is_host for is_host, parts in waiting.items() for _ in parts]
    random.shuffle(turns)
    chunks = [(is_host, waiting[is_host].pop(0)) for is_host in turns]
    if is_tcp:
        found = conversation([(True, LITTLE.encode(QueryServoListRequest())), *chunks], tmp_path)[1:]
    else:
        stamped = [Captured(at, "sent" if is_host else "received", data) for at, (is_host, data) in enumerate(chunks)]
        found = [frame for frame in lines(stamped, tmp_path) if "cut" not in frame.experts]
    for is_host, packets in streams.items():
        names = {type(packet).__name__ for packet in packets}
        of_stream = [frame for frame in found if frame.get("packet") in names]
        assert [frame.content for frame in of_stream] == [shown(packet, LITTLE) for packet in packets], is_host
    assert len(found) == sum(map(len, streams.values()))


def test_a_damaged_frame_hides_no_other(tmp_path: Path) -> None:
    action = LITTLE.encode(AddActionRequest(3, "Wave", (Step(1, 30, 5),)))
    damaged = bytearray(LITTLE.encode(QueryServoRequest(5)))
    damaged[8] ^= 4
    long = bytearray(LITTLE.encode(QueryServoListRequest()))
    long[4:8] = (30030).to_bytes(2, "little") + (38 + 5).to_bytes(2, "little")  # a length that swallows the next
    data = bytes(damaged) + action + b"noise" + action + bytes(long) + action + bytes(50)
    found = lines([Captured(0, "sent", data)], tmp_path)
    seen = [(frame.get("packet"), *sorted(frame.experts - {"unanswered"})) for frame in found]
    assert seen == [
        ("QueryServoRequest", "checksum.bad"),
        ("AddActionRequest",),
        (None, "noise.seen"),
        ("AddActionRequest",),
        (None, "noise.seen"),
        ("AddActionRequest",),
        (None,),
    ]
    assert found[0].get("checksum.status") == "bad"
    assert found[2].get("noise") == b"noise".hex(":")
    assert found[4].get("noise") == bytes(long).hex(":")
    assert found[6].get("padding") == bytes(50).hex(":")


def test_packets_that_no_document_defines(tmp_path: Path) -> None:
    found = lines([Captured(0, "received", encode_frame(50021, b"new", "little"))], tmp_path)
    assert [(frame.get("packet_id"), frame.get("content"), frame.experts) for frame in found] == [
        ("50021", b"new".hex(":"), {"packet.unknown"})
    ]


def test_a_content_that_contradicts_itself(tmp_path: Path) -> None:
    lying = encode_frame(QueryServoResponse.packet_id, b"\x02" + bytes(11), "little")
    (frame,) = lines([Captured(0, "received", lying)], tmp_path)
    assert (frame.get("servos.count"), frame.experts) == ("2", {"content.bad"})


@pytest.mark.parametrize("is_tcp", [True, False], ids=["tcp", "line"])
def test_garbage_breaks_nothing(is_tcp: bool, tmp_path: Path) -> None:
    random = Random(SEED)
    good = LITTLE.encode(QueryServoRequest(9))
    chunks = [good]
    for _ in range(150):
        frame = bytearray(LITTLE.encode(drawn(PACKETS[random.choice(sorted(PACKETS))], random)))
        for _ in range(random.randint(0, 3)):
            frame[random.randrange(len(frame))] = random.randrange(256)
        chunks.append(bytes(frame) if random.random() < 0.7 else random.randbytes(random.randint(1, 60)))
    # Zeros end whatever frame is still open: no length is claimed that is longer than these.
    chunks += [bytes(1000)] * 66 + [good]
    if is_tcp:
        found = conversation([(True, chunk) for chunk in chunks], tmp_path)
    else:
        found = lines([Captured(at, "sent", chunk) for at, chunk in enumerate(chunks)], tmp_path)
    assert found[0].get("servo_id") == found[-1].get("servo_id") == "9"


def test_any_port_is_recognised_by_the_magic_alone(tmp_path: Path) -> None:
    good = LITTLE.encode(QueryServoRequest(9))
    assert conversation([(True, b"GET / HTTP/1.1\r\n\r\n"), (True, b"\x13\x4c\x05\x1dnothing")], tmp_path) == []
    found = conversation([(True, good), (False, b"behind it all is ours" + good)], tmp_path)
    assert [frame.get("noise") is None for frame in found] == [True, False, True]


def exchanges(found: list[Frame]) -> list[tuple[str | None, ...]]:
    """Return for each frame where its response is, its request, and how long it took."""
    return [tuple(map(frame.get, ("response_in", "response_to", "response_time"))) for frame in found]


@pytest.mark.parametrize("order", ["little", "big"])
def test_requests_and_their_responses(order: ByteOrder, tmp_path: Path) -> None:
    packets = [
        QueryActionRequest(1),
        QueryActionRequest(2),
        ButtonEventResponse(1, 1),
        QueryActionResponse(2),
        QueryActionResponse(1),
        QueryMemorySizeRequest(),
        QueryMemorySizeRequest(),
        QueryMemorySizeResponse(7),
        AddActionRequest(5),
        AddActionResponse(0),
        AddActionResponse(1),
    ]
    found = lines(line([(packet, Codec(order).encode(packet)) for packet in packets], 1_500_001), tmp_path)
    assert exchanges(found) == [
        ("5", None, None),
        ("4", None, None),
        (None, None, None),
        (None, "2", "0.003000002"),
        (None, "1", "0.006000004"),
        (None, None, None),
        ("8", None, None),
        (None, "7", "0.001500001"),
        ("10", None, None),
        (None, "9", "0.001500001"),
        (None, None, None),
    ]
    assert found[6].get("repeats") == "6"
    assert [sorted(frame.experts) for frame in found if frame.experts] == [["unanswered"], ["failed"]]


def test_a_response_after_the_patience_belongs_to_no_request(tmp_path: Path) -> None:
    packets = [QueryMemorySizeRequest(), QueryMemorySizeResponse(7)]
    frames = line([(packet, LITTLE.encode(packet)) for packet in packets], 5_000_000_000)
    assert exchanges(lines(frames, tmp_path))[1] == (None, None, None)
    assert exchanges(lines(frames, tmp_path, Preferences(option="servolink.patience:6000")))[1] == (
        None,
        "1",
        "5.000000000",
    )
