"""Queries alone tell what kind of board it is, and a bad line makes no finding both wrong and certain."""

from __future__ import annotations

import asyncio
import random
from collections import deque
from typing import Any

import pytest

from servolink.doctor.learn_line import Quality
from servolink.doctor.learn_queries import Survey, unsupported_finding
from servolink.errors import OpenError
from servolink.protocol import Codec, QueryMacroRequest, QueryMemorySizeRequest, QueryRemainPowerRequest
from servolink.transports import Faults, Transport, WrappedTransport
from servolink.virtual import HANDLERS, BoardKind, VirtualBoard
from tests.doctor.learning import CHINESE, FULL, board_of, described, learn

BUSY = 0.005  # seconds for each request, so that others have to wait


def test_a_board_as_the_document_describes_it() -> None:
    found = learn(board_of())
    assert {name: each.value for name, each in found.items()} == {
        "byte_order": "little",
        "power_up_mode": 1,
        "transmission_mode": "auto",
        "caption_encoding": None,  # nothing but ASCII is stored
        "unsupported": (),
        "unknown_ids": "empty",
        "turnaround": 0.0,
        "depth": 16,
    }
    assert {each.confidence for each in found.values() if each.value is not None} == {"certain"}


@pytest.mark.parametrize(
    ("kind", "codec", "captions", "setting", "value"),
    [
        (FULL, Codec("big"), ("wave",), "byte_order", "big"),
        (BoardKind(mode=0), None, ("wave",), "power_up_mode", 0),
        (BoardKind(mode=0), None, ("wave",), "transmission_mode", 1),
        (BoardKind(mode=0), Codec("big"), ("wave",), "byte_order", "big"),
        (FULL, Codec(caption_encoding="gbk"), CHINESE, "caption_encoding", "gb18030"),
        (FULL, Codec(caption_encoding="big5"), ("揮手", "抬起右腿", "前進"), "caption_encoding", "big5"),
        (FULL, Codec("big", "utf-8"), CHINESE, "caption_encoding", "utf-8"),
        (FULL, Codec("big", "utf-16-le"), (*CHINESE, "ok"), "caption_encoding", "utf-16-le"),
        (FULL, Codec(caption_encoding="shift_jis"), ("手を振る", "左手"), "caption_encoding", "shift_jis"),
        (BoardKind(unknown_ids="silent"), None, ("wave",), "unknown_ids", "silent"),
        (BoardKind(unsupported=("QueryMemorySize",)), None, ("wave",), "unsupported", ("QueryMemorySize",)),
        (BoardKind(unsupported=("QueryProjectID",)), None, ("wave",), "unsupported", ("QueryProjectID",)),
        (
            BoardKind(unsupported=("QueryServoParameter", "QueryRemainPower")),
            Codec("big"),
            ("wave",),
            "unsupported",
            ("QueryRemainPower", "QueryServoParameter"),
        ),
        (BoardKind(unsupported=("QueryMacro",)), None, ("wave",), "unsupported", ("QueryMacro",)),
        (BoardKind(turnaround=BUSY), None, ("wave",), "turnaround", BUSY),
        (BoardKind(turnaround=BUSY), None, ("wave",), "depth", 16),
        (BoardKind(turnaround=BUSY, queue=0), None, ("wave",), "depth", 1),
        (BoardKind(turnaround=BUSY, queue=1), None, ("wave",), "depth", 2),
        (BoardKind(turnaround=BUSY, queue=4), None, ("wave",), "depth", 4),
        (BoardKind(turnaround=BUSY, queue=4), Codec("big"), ("wave",), "depth", 4),
        (BoardKind(turnaround=BUSY, queue_bytes=13 * 7), None, ("wave",), "depth", 8),
        (BoardKind(turnaround=BUSY, queue_bytes=13 * 6), None, ("wave",), "depth", 4),
        (BoardKind(turnaround=0.3, queue=0), None, ("wave",), "depth", 1),
    ],
    ids=described,
)
def test_each_kind_is_learnt(
    kind: BoardKind, codec: Codec | None, captions: tuple[str, ...], setting: str, value: Any
) -> None:
    board = board_of(kind, codec, captions)
    before = board.storage.contents
    found = learn(board)
    assert found[setting].value == (pytest.approx(value, abs=1e-4) if isinstance(value, float) else value)
    assert found[setting].confidence == "certain"
    assert board.storage.contents is before, "queries change nothing"


def test_the_mode_at_power_up_is_not_learnt_of_a_board_that_was_on() -> None:
    found = learn(board_of(BoardKind(mode=0)), power_cycled=False)
    assert (found["power_up_mode"].value, found["transmission_mode"].value) == (None, 1)
    assert found["transmission_mode"].confidence == "likely"
    found = learn(board_of(), power_cycled=False)
    assert found["power_up_mode"].value is None
    assert "transmission_mode" not in found


def test_an_empty_board_tells_less() -> None:
    found = learn(VirtualBoard(servos=0))
    assert found["caption_encoding"].value is None
    assert found["caption_encoding"].evidence == "no caption is stored on the board"
    assert found["unknown_ids"].value == "empty"
    assert found["depth"].value == 16


def test_a_slow_board_is_not_tried_for_ever() -> None:
    found = learn(board_of(BoardKind(turnaround=0.35)))
    assert (found["depth"].value, found["depth"].confidence) == (4, "certain")
    assert "more were not tried, as the board is slow" in found["depth"].evidence


class Mixing(WrappedTransport):
    """A transport behind which a board answers each request twice, or two together in the wrong order."""

    def __init__(self, inner: Transport, *, twice: bool) -> None:
        super().__init__(inner)
        self._twice = twice
        self._held = b""

    def data(self, chunk: bytes, /) -> None:
        if self._twice:
            self._deliver(2 * chunk)
        elif self._held:
            self._deliver(chunk + self._held)
            self._held = b""
        else:
            self._held = chunk
            asyncio.get_running_loop().call_later(2 * BUSY, self._free)

    def _free(self) -> None:
        held, self._held = self._held, b""
        self._deliver(held)


@pytest.mark.parametrize("twice", [True, False], ids=["twice", "swapped"])
def test_a_board_that_mixes_its_responses_is_asked_one_by_one(twice: bool) -> None:
    found = learn(board_of(BoardKind(turnaround=BUSY)), behind=lambda inner: Mixing(inner, twice=twice))
    assert (found["depth"].value, found["depth"].confidence) == (1, "certain")
    assert "8 of 8 bursts of 2 queries were answered in another order, or more than once" in found["depth"].evidence


class Stalling(WrappedTransport):
    """A transport behind which a board, or the machine, stops for a while: nothing is lost, all comes later."""

    def __init__(self, inner: Transport, seed: int, longest: float) -> None:
        super().__init__(inner)
        self._random = random.Random(seed)
        self._longest = longest
        self._free_at = 0.0
        self._prompt = 80  # responses, until the board is found
        self._late = deque[bytes]()  # in order: equal times of timers have none

    def data(self, chunk: bytes, /) -> None:
        loop = asyncio.get_running_loop()
        self._prompt -= 1
        if self._prompt < 0 and self._random.random() < 0.05:
            self._free_at = max(self._free_at, loop.time() + self._random.uniform(0, self._longest))
        self._late.append(chunk)
        loop.call_at(max(self._free_at, loop.time()), lambda: self._deliver(self._late.popleft()))


@pytest.mark.parametrize("seed", range(8))
def test_a_late_response_is_not_a_lost_one(seed: int) -> None:
    kind = BoardKind(turnaround=BUSY, unsupported=("QueryRemainPower",), unknown_ids="silent")
    found = learn(board_of(kind), behind=lambda inner: Stalling(inner, seed, 1.0))
    values = found["depth"].value, found["unsupported"].value, found["unknown_ids"].value
    assert values == (16, ("QueryRemainPower",), "silent")
    assert found["depth"].confidence in {"certain", "likely"}


@pytest.mark.parametrize("seed", range(8))
def test_a_depth_is_uncertain_where_the_board_stops_for_seconds(seed: int) -> None:
    found = learn(board_of(BoardKind(turnaround=BUSY)), behind=lambda inner: Stalling(inner, seed, 15.0))
    assert found["depth"].value == 16 or found["depth"].confidence == "guess"


@pytest.mark.virtual_only("the test changes how the virtual board handles a request")
def test_boards_may_answer_some_unknown_ids_and_not_others(monkeypatch: Any) -> None:
    monkeypatch.setitem(HANDLERS, QueryMacroRequest, lambda context: None)
    found = learn(VirtualBoard(servos=2))
    assert (found["unknown_ids"].value, found["unknown_ids"].confidence) == ("silent", "likely")
    assert "QueryMacro 1 had none in 6 tries each" in found["unknown_ids"].evidence


def test_nothing_is_learnt_where_no_board_answers() -> None:
    everything = tuple(
        f"Query{name}" for name in ("ProjectID", "MemorySize", "RemainPower", "ActiveJoystickTable", "ServoList")
    )
    with pytest.raises(OpenError, match="does not answer in either byte order or transmission mode"):
        learn(board_of(BoardKind(unsupported=everything)))


TRUTH = {
    "byte_order": ("big",),
    "power_up_mode": (1,),
    "transmission_mode": ("auto",),
    "caption_encoding": ("gb18030",),
    "unsupported": (("QueryRemainPower",),),
    "unknown_ids": ("silent",),
    "depth": (1, 2, 4),
}
"""What may be said with certainty of the board that is learnt over bad lines."""


@pytest.mark.parametrize(
    "faults", [Faults(drop=0.05), Faults(drop=0.005), Faults(flip=0.005, insert=0.002)], ids=["05", "005", "noise"]
)
@pytest.mark.parametrize("seed", range(8))
def test_a_bad_line_makes_nothing_wrong_certain(faults: Faults, seed: int) -> None:
    kind = BoardKind(turnaround=BUSY, queue=4, unknown_ids="silent", unsupported=("QueryRemainPower",))
    board = board_of(kind, Codec("big", "gbk"), CHINESE)
    try:
        found = learn(board, faults=faults, seed=seed)
    except OpenError:
        return  # too bad to find the board at all
    wrong = {
        name: each
        for name, each in found.items()
        if each.confidence == "certain" and each.value is not None and each.value not in TRUTH.get(name, (each.value,))
    }
    assert not wrong


@pytest.mark.parametrize(("answered", "confidence"), [(10, "certain"), (9, "guess")])
def test_unreadable_answers_prove_nothing_on_a_bad_line(answered: int, confidence: str) -> None:
    survey = Survey(frames={QueryMemorySizeRequest(): (10, b"")}, garbled={QueryRemainPowerRequest(): "text"})
    found = unsupported_finding(survey, Quality(10, (0.01,) * answered))
    assert (found.value, found.confidence) == ((), confidence)
