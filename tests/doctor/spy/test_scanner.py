"""Frames of any byte order and id, however they are cut."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from servolink.doctor.spy.scanner import Scanner, Seen
from servolink.protocol import ByteOrder, Codec, QueryServoListRequest, QueryServoRequest, encode_frame
from tests.protocol.declared import any_packet

LITTLE, BIG = (Codec(order).encode(QueryServoRequest(7)) for order in ("little", "big"))


def scan(*chunks: bytes, step: float = 0.0) -> list[Seen]:
    """Return what a scanner finds in chunks that pass `step` seconds apart."""
    scanner = Scanner()
    found = [seen for at, chunk in enumerate(chunks) for seen in scanner.feed(at * step, chunk)]
    return found + scanner.finish()


def test_both_byte_orders_in_one_stream() -> None:
    assert scan(LITTLE + BIG[:3], BIG[3:] + LITTLE) == [
        Seen("packet", LITTLE, "little", 20020),
        Seen("packet", BIG, "big", 20020),
        Seen("packet", LITTLE, "little", 20020),
    ]


def test_what_is_unknown_damaged_or_noise() -> None:
    unknown = encode_frame(50021, b"new", "big")
    damaged = LITTLE[:-1] + bytes([LITTLE[-1] ^ 1])
    assert scan(b"no" + unknown[:9], unknown[9:] + damaged + b"ise" + LITTLE) == [
        Seen("noise", b"no"),
        Seen("unknown", unknown, "big", 50021),
        Seen("damaged", damaged, "little", 20020),
        Seen("noise", b"ise"),
        Seen("packet", LITTLE, "little", 20020),
    ]


def test_a_damaged_length_hides_no_frame() -> None:
    long = LITTLE[:4] + (30030).to_bytes(2, "little") + (38 + 5 * 9).to_bytes(2, "little") + LITTLE[8:]
    assert scan(long + LITTLE + bytes(100)) == [
        Seen("noise", long),
        Seen("packet", LITTLE, "little", 20020),
        Seen("noise", bytes(100)),
    ]


def test_a_frame_without_its_end_is_given_up_after_a_silence() -> None:
    assert scan(LITTLE[:-2], LITTLE, step=1.0) == [Seen("noise", LITTLE[:-2]), Seen("packet", LITTLE, "little", 20020)]
    assert scan(encode_frame(50021, bytes(60), "big")[:-2]) == [
        Seen("noise", encode_frame(50021, bytes(60), "big")[:-2])
    ]


def test_the_order_of_an_unknown_packet_without_content() -> None:
    assert [seen.packet_id for seen in scan(encode_frame(50020, b"", "big"), encode_frame(50020, b"", "little"))] == [
        50020,
        50020,
    ]


@given(
    st.lists(any_packet | st.binary(max_size=20), max_size=6), st.sampled_from(("little", "big")), st.integers(1, 40)
)
def test_no_byte_is_lost(parts: list[object], order: ByteOrder, size: int) -> None:
    codec = Codec(order)
    frames = [part if isinstance(part, bytes) else codec.encode(part, unchecked=True) for part in parts]  # type: ignore[arg-type]
    stream = b"".join(frames)
    found = scan(*(stream[at : at + size] for at in range(0, len(stream), size)))
    assert b"".join(seen.data for seen in found) == stream


def test_a_frame_is_returned_as_soon_as_it_is_whole() -> None:
    scanner, asked = Scanner(), Codec().encode(QueryServoListRequest())
    assert [len(scanner.feed(0.0, asked[at : at + 1])) for at in range(len(asked))] == [0] * 8 + [1]
