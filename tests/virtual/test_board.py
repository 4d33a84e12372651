"""The board as a whole: sessions, time, noise, and anything at all as input.

Module: servolink.virtual.hardware.
"""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servolink.protocol import (
    PACKETS,
    Codec,
    ExecuteMacroRequest,
    FrameParser,
    MacroCommand,
    Packet,
    QueryMemorySizeRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SendDummyDataRequest,
    TransmissionModeSettingRequest,
    encode_frame,
)
from servolink.virtual.board import VirtualBoard
from servolink.virtual.hardware import Hardware
from servolink.virtual.kind import BoardKind
from tests.proofs.fuzz.amounts import MANY
from tests.protocol.declared import any_packet
from tests.virtual.host import START, Host

CODEC = Codec()


def test_a_fresh_board_is_empty_and_ready() -> None:
    host = Host(VirtualBoard())
    assert host.ask(QueryServoListRequest()).servo_id_list == tuple(range(1, 17))
    states = host.ask(QueryServoRequest(255)).servos
    assert all(state.is_start and state.is_hold for state in states)
    assert host.board.next_due(START) is None


@pytest.mark.parametrize("servos", [0, 1, Hardware.MAX_SERVOS])
def test_it_has_as_many_servos_as_it_was_given(servos: int) -> None:
    assert len(Host(VirtualBoard(servos)).ask(QueryServoRequest(255)).servos) == servos


@pytest.mark.parametrize("servos", [-1, Hardware.MAX_SERVOS + 1])
def test_more_servos_than_ids_are_refused(servos: int) -> None:
    with pytest.raises(ValueError, match=f"servos must be 0..254, not {servos}"):
        VirtualBoard(servos)


def test_the_seed_makes_the_board() -> None:
    def states(seed: int) -> object:
        return Host(VirtualBoard(seed=seed)).ask(QueryServoRequest(255))

    assert states(1) == states(1)
    assert states(1) != states(2)


def test_answers_come_in_the_order_of_the_requests() -> None:
    host = Host(VirtualBoard())
    requests = [QueryMemorySizeRequest(), QueryServoListRequest(), QueryRemainPowerRequest(), QueryServoListRequest()]
    host.session.receive(b"".join(map(CODEC.encode, requests)), START)
    assert [heard.packet_id for heard in host.heard] == [request.packet_id + 1 for request in requests]


def test_each_session_hears_its_own_answers() -> None:
    board = VirtualBoard()
    one, other = Host(board), Host(board)
    assert one.ask(QueryServoListRequest()).servo_id_list
    assert other.heard == []


def test_frames_survive_noise_and_any_cutting() -> None:
    host = Host(VirtualBoard(servos=1))
    stream = (
        b"\x13\x4cnoise"
        + CODEC.encode(QueryServoListRequest())
        + b"\x13\x4c\x05\x1d\xff\xff"
        + CODEC.encode(QueryServoListRequest())
    )
    for at in range(len(stream)):
        host.session.receive(stream[at : at + 1], START)
    assert host.heard == [QueryServoListResponse((1,))] * 2


def test_what_only_boards_send_and_what_lies_about_its_length_is_ignored() -> None:
    host = Host(VirtualBoard())
    assert host.tell(QueryServoListResponse((1,))) == []
    lying = encode_frame(20050, b"\x02" + bytes(5), "little")  # two steps announced, one there
    host.session.receive(lying, START)
    assert host.heard == []


def test_half_a_frame_and_silence_do_not_swallow_what_comes_next() -> None:
    host = Host(VirtualBoard())
    half = CODEC.encode(SendDummyDataRequest(bytes(60000)))[:5000]
    host.session.receive(half, START)
    assert host.tell(QueryServoListRequest(), START + 0.1) == []  # may still be part of the long frame
    assert len(host.tell(QueryServoListRequest(), START + 0.4)) == 2  # given up, and the request inside it found
    assert len(host.tell(QueryServoListRequest(), START + 0.5)) == 1


def test_half_a_frame_is_kept_while_more_of_it_waits_to_be_passed_on() -> None:
    host = Host(VirtualBoard())
    frame = CODEC.encode(QueryServoListRequest())
    host.session.receive(frame[:8], START)
    host.session.receive(b"", START + 9)
    host.session.receive(frame[8:], START + 9)
    assert len(host.heard) == 1


def test_a_frame_in_two_parts_is_one_frame_when_the_second_comes_soon() -> None:
    host = Host(VirtualBoard())
    frame = CODEC.encode(QueryServoListRequest())
    host.session.receive(frame[:8], START)
    host.session.receive(frame[8:], START + 0.2)
    assert len(host.heard) == 1


def test_a_host_that_left_hears_nothing_more_not_even_of_what_it_asked() -> None:
    board = VirtualBoard()
    heard: list[bytes] = []

    def hear(data: bytes) -> None:
        heard.append(data)
        session.detach()

    session = board.attach(hear)
    session.receive(CODEC.encode(QueryServoListRequest()) * 3, START)
    assert len(heard) == 1
    session.detach()  # twice does no harm


def test_watchers_learn_that_something_came_from_outside() -> None:
    board, calls = VirtualBoard(), []
    host = Host(board)
    host.store_macro(1, MacroCommand(100, 1))

    def changed() -> None:
        calls.append(board.next_due(START))

    board.watch(changed)
    host.ask(ExecuteMacroRequest(1))
    board.press_button(1, START)
    assert len(calls) == 2
    assert calls[0] == START
    board.unwatch(changed)
    board.release_button(1, START)
    assert len(calls) == 2


def test_next_due_is_never_in_the_past() -> None:
    host = Host(VirtualBoard())
    host.store_macro(1, MacroCommand(100, 1))
    host.ask(ExecuteMacroRequest(1))
    assert host.board.next_due(START + 7) == START + 7


def _garbled(packet: Packet, at: int, bit: int) -> bytes:
    """Return a frame of `packet` with one bit of its content changed and a right sum: values no host would send."""
    content = bytearray(CODEC.encode(packet)[8:-1])
    if content:
        content[at % len(content)] ^= 1 << bit
    return encode_frame(packet.packet_id, bytes(content), "little")


anything = st.one_of(
    st.binary(max_size=40),
    any_packet.map(CODEC.encode),
    any_packet.map(CODEC.encode).map(lambda frame: frame[: len(frame) // 2]),
    st.builds(_garbled, any_packet, st.integers(0, 10**6), st.integers(0, 7)),
    st.builds(encode_frame, st.sampled_from(sorted(PACKETS)), st.binary(max_size=60), st.just("little")),
)
step = st.tuples(anything, st.floats(0, 1e6) | st.just(0.0), st.none() | st.tuples(st.booleans(), st.integers(0, 3)))


@settings(max_examples=20 * MANY)
@given(st.lists(step, max_size=25))
def test_no_input_at_any_time_stops_or_fills_it(steps: list[tuple[bytes, float, tuple[bool, int] | None]]) -> None:
    board = VirtualBoard(servos=3, kind=BoardKind(memory=2000))
    said: list[bytes] = []
    session = board.attach(said.append)
    now = START
    for data, pause, button in steps:
        now += pause
        session.receive(data, now)
        if button is not None:
            (board.press_button if button[0] else board.release_button)(button[1], now)
        due = board.next_due(now)
        assert due is None or due >= now
    assert 0 <= board.storage.used <= 2000
    assert 0 <= board.battery <= 1000
    frames = FrameParser().feed(b"".join(said))
    assert len(frames) == len(said)
    assert all(PACKETS[packet_id] for packet_id, _ in frames)
    # However it was left, it answers the next host.
    host = Host(board)
    host.session.receive(CODEC.encode(TransmissionModeSettingRequest(1)), now)
    assert host.ask(QueryServoListRequest(), now).servo_id_list == (1, 2, 3)
