"""Every way in which a board may lie."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, cycle, repeat
from random import Random

from servolink.protocol import (
    HEADER,
    HEADER_SIZE,
    MAGIC,
    ActionEntry,
    ButtonEventResponse,
    ByteOrder,
    Codec,
    JoystickTableEntry,
    MacroEntry,
    Packet,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryJoystickTableListRequest,
    QueryJoystickTableListResponse,
    QueryMacroListRequest,
    QueryMacroListResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    SetServoParameterResponse,
    encode_frame,
)
from tests.proofs.fuzz.recipes import RESPONSE_IDS, shape
from tests.proofs.hostile.lying_board import LATENCY, Lie, Speech, truth

_PUSH = Codec().encode(ButtonEventResponse(1, 1))
_STOPPED = Codec().encode(SetServoParameterResponse(255, 0, 1))
_NOTHING_LISTED = Codec().encode(QueryActionListResponse(()))
_ORDER: ByteOrder = "little"
_FEW, _MOST_ENTRIES = 5, 1820  # entries of 36 bytes in the longest answer


@dataclass(frozen=True)
class Lying:
    """How a board lies, anew for each connection."""

    lie: Callable[[], Lie] = lambda: truth
    unasked: Callable[[], Speech] = tuple
    long: bool = False
    """It has so much to say that what reads all of it takes long."""


def _said(change: Callable[[Packet, bytes], bytes]) -> Callable[[], Lie]:
    """Say something else instead of the truth."""
    return lambda: lambda packet, answer: [(LATENCY, change(packet, answer))] if answer else []


def _content(change: Callable[[int, bytes], bytes]) -> Callable[[], Lie]:
    """Say another content, in a frame that is right."""

    def changed(packet: Packet, answer: bytes) -> bytes:
        response_id = packet.packet_id + 1
        return encode_frame(response_id, change(response_id, answer[HEADER_SIZE:-1]), _ORDER)

    return _said(changed)


def _counted(by: int) -> Callable[[int, bytes], bytes]:
    def changed(response_id: int, content: bytes) -> bytes:
        rule, size = shape(response_id, _ORDER)
        at = rule.base - size
        number = (int.from_bytes(content[at : rule.base], _ORDER) + by) % 256**size if size else 0
        return content[:at] + number.to_bytes(size, _ORDER) + content[rule.base :]

    return changed


def _longest(fill: bytes) -> Callable[[int, bytes], bytes]:
    def changed(response_id: int, content: bytes) -> bytes:
        rule, size = shape(response_id, _ORDER)
        whole = (fill * (rule.base + rule.unit * rule.limit))[: rule.base + rule.unit * rule.limit]
        return whole[: rule.base - size] + (rule.limit if size else 0).to_bytes(size, _ORDER) + whole[rule.base :]

    return changed


def _listing(entries: int, record_id: Callable[[int], int], *, of_each: bool = True) -> Callable[[], Lie]:
    """List records that are not there, of each kind or actions only."""

    def lie(packet: Packet, answer: bytes) -> Speech:
        ids = [record_id(at) for at in range(entries if of_each or isinstance(packet, QueryActionListRequest) else 0)]
        match packet:
            case QueryActionListRequest():
                said: Packet = QueryActionListResponse(tuple(ActionEntry(one, "wave") for one in ids))
            case QueryMacroListRequest():
                said = QueryMacroListResponse(tuple(MacroEntry(one, "dance") for one in ids))
            case QueryJoystickTableListRequest():
                said = QueryJoystickTableListResponse(tuple(JoystickTableEntry(one, "pad") for one in ids))
            case _:
                return truth(packet, answer)
        return [(LATENCY, Codec().encode(said, unchecked=True))]

    return lambda: lie


def _growing() -> Lie:
    """List one more each time."""
    lengths = count(1)

    def lie(packet: Packet, answer: bytes) -> Speech:
        return _listing(next(lengths) % _MOST_ENTRIES, lambda at: at + 1)()(packet, answer)

    return lie


def _alternating() -> Lie:
    """Say something else each time."""
    times = count()

    def lie(packet: Packet, answer: bytes) -> Speech:
        at = next(times) % 7
        if isinstance(packet, QueryProjectIDRequest):
            return [(LATENCY, Codec().encode(QueryProjectIDResponse(at)))]
        return _listing(at, lambda number: number + at)()(packet, answer)

    return lie


def _changing_when_read() -> Lie:
    """Say the same twice, and then, when all that it lists was read, something else."""
    times = Counter[int]()

    def lie(packet: Packet, answer: bytes) -> Speech:
        times[packet.packet_id] += 1
        return _listing(1 + (times[packet.packet_id] % 3 == 0), lambda at: at + 1)()(packet, answer)

    return lie


def _one_after_the_other(pause: float) -> Callable[[], Lie]:
    return lambda: lambda packet, answer: ((pause, answer[at : at + 1]) for at in range(len(answer)))


def _slow_and_long(pause: float) -> Callable[[], Lie]:
    def lie(packet: Packet, answer: bytes) -> Speech:
        if not answer:
            return ()
        response_id = packet.packet_id + 1
        frame = encode_frame(response_id, _longest(b"\x01")(response_id, answer[HEADER_SIZE:-1]), _ORDER)
        step = len(frame) // 100 + 1
        return ((pause, frame[at : at + step]) for at in range(0, len(frame), step))

    return lambda: lie


def _hidden(damage: bool) -> Callable[[], Lie]:
    """Hide answers in whatever is text or padding, in frames that are right or not."""

    def changed(packet: Packet, answer: bytes) -> bytes:
        own = encode_frame(packet.packet_id + 1, answer[HEADER_SIZE:-1][:9], _ORDER)
        frame = encode_frame(
            packet.packet_id + 1, _longest(_STOPPED + _PUSH + own)(packet.packet_id + 1, answer[HEADER_SIZE:-1]), _ORDER
        )
        return frame[:-1] + bytes([frame[-1] ^ damage])

    return _said(changed)


def _zeros() -> Callable[[], Lie]:
    return _content(lambda response_id, content: bytes(len(content)))


def _replies_to_nothing(pause: float = 0.02) -> Speech:
    """Answer what was not asked, for ever."""
    frames = []
    for response_id in RESPONSE_IDS:
        rule, _ = shape(response_id, _ORDER)
        frames.append(encode_frame(response_id, bytes(rule.base), _ORDER))
    return zip(repeat(pause), cycle(frames))


def _noise(seed: int) -> Speech:
    random = Random(seed)
    return ((0.01, random.randbytes(200)) for _ in count())


LIES: dict[str, Lying] = {
    "none": Lying(),
    "counts one more": Lying(_content(_counted(1))),
    "counts one less": Lying(_content(_counted(-1))),
    "counts most": Lying(_content(_counted(-2))),
    "says zeros": Lying(_zeros()),
    "says ones": Lying(_content(lambda response_id, content: b"\xff" * len(content))),
    "says less": Lying(_content(lambda response_id, content: content[: len(content) // 2])),
    "says nothing inside": Lying(_content(lambda response_id, content: b"")),
    "says the longest, zeros": Lying(_content(_longest(b"\0")), long=True),
    "says the longest, ones": Lying(_content(_longest(b"\xff")), long=True),
    "says the longest, all different": Lying(_content(_longest(bytes(range(1, 252)))), long=True),
    "answers for another": Lying(_content(lambda response_id, content: bytes([content[0] ^ 3]) + content[1:])),
    "answers another request": Lying(_said(lambda packet, answer: encode_frame(30011, b"\0\0", _ORDER))),
    "answers as a host": Lying(_said(lambda packet, answer: Codec().encode(packet, unchecked=True))),
    "answers with the other byte order": Lying(
        _said(lambda packet, answer: encode_frame(packet.packet_id + 1, answer[HEADER_SIZE:-1], "big"))
    ),
    "answers with wrong sums": Lying(_said(lambda packet, answer: answer[:-1] + bytes([answer[-1] ^ 1]))),
    "answers nothing": Lying(lambda: lambda packet, answer: ()),
    "answers twenty times": Lying(_said(lambda packet, answer: answer * 20)),
    "answers late": Lying(lambda: lambda packet, answer: [(1.5, answer)] if answer else []),
    "answers byte by byte": Lying(_one_after_the_other(0.02)),
    "answers byte by byte, as slowly as it may": Lying(_one_after_the_other(0.9), long=True),
    "answers the longest, as slowly as it may": Lying(_slow_and_long(0.9), long=True),
    "begins and never ends": Lying(_said(lambda packet, answer: answer[:-1])),
    "begins the longest": Lying(
        _said(lambda packet, answer: HEADER[_ORDER].pack(MAGIC, packet.packet_id + 1, 0xFFFF) + answer)
    ),
    "hides answers": Lying(_hidden(damage=False), long=True),
    "hides answers in damaged frames": Lying(_hidden(damage=True), long=True),
    "lists one record many times": Lying(_listing(_MOST_ENTRIES, lambda at: 1), long=True),
    "lists what is not there": Lying(_listing(_FEW, lambda at: at + 100)),
    "lists what cannot be": Lying(_listing(_FEW, lambda at: [0, -1, -(2**31), 2**31 - 1, 0][at])),
    "lists all that fits": Lying(_listing(_MOST_ENTRIES, lambda at: at + 1, of_each=False), long=True),
    "lists one more each time": Lying(_growing),
    "never says the same": Lying(_alternating),
    "says something else when it was read": Lying(_changing_when_read),
    "pushes events without end": Lying(unasked=lambda: zip(repeat(0.001), repeat(_PUSH * 3))),
    "answers nothing, pushes without end": Lying(
        lambda: lambda packet, answer: (), lambda: zip(repeat(0.01), repeat(_PUSH))
    ),
    "answers what nobody asked": Lying(unasked=_replies_to_nothing),
    "answers what nobody asked, so fast that no command gets through": Lying(
        unasked=lambda: _replies_to_nothing(0.01), long=True
    ),
    "answers what nobody asked, and seldom pauses": Lying(
        unasked=lambda: zip(cycle((*repeat(0.02, 240), 0.11)), repeat(_NOTHING_LISTED)), long=True
    ),
    "only answers what nobody asked": Lying(lambda: lambda packet, answer: (), _replies_to_nothing),
    "makes noise": Lying(unasked=lambda: _noise(1)),
    "only makes noise": Lying(lambda: lambda packet, answer: (), lambda: _noise(2)),
    "begins frames without end": Lying(
        unasked=lambda: zip(repeat(0.01), repeat(HEADER[_ORDER].pack(MAGIC, 10050, 0xFFFF)))
    ),
    "begins a frame and goes on for ever": Lying(
        lambda: lambda packet, answer: (),
        lambda: ((0.04, b"x") if at else (0.04, HEADER[_ORDER].pack(MAGIC, 10031, 8)) for at in count()),
    ),
    "sends padding without end": Lying(unasked=lambda: zip(repeat(0.01), repeat(bytes(640)))),
}
"""By name; "none" shows that the tests can tell a lie from the truth."""
