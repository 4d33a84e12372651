"""What is learnt of virtual boards of all kinds, from raw bytes of a client that knows nothing of servolink.

Module: servolink.doctor.spy.learning.
"""

from __future__ import annotations

from random import Random
from typing import Any, Literal

import pytest

from servolink.doctor.spy.learning import Learner, Passed
from servolink.doctor.spy.verdict import verdict
from servolink.protocol import (
    AddActionRequest,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    ByteOrder,
    ClearAllDataRequest,
    Codec,
    ExecuteActionRequest,
    MacroCommand,
    Packet,
    QueryActionRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    ServoParameter,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    encode_frame,
)
from servolink.recorder import Direction
from servolink.virtual import BoardKind, VirtualBoard

LATENCY = 0.004


class Line:
    """A client and a board with a spy in between."""

    def __init__(self, codec: Codec, kind: BoardKind | None = None, random: Random | None = None) -> None:
        self.learner = Learner(codec.caption_encoding)
        self.passed: list[Passed] = []
        self.now = 100.0
        self._codec, self._random = codec, random
        self._board = VirtualBoard(3, 0, codec, kind or BoardKind())
        self._said: list[bytes] = []
        self._session = self._board.attach(self._said.append)

    def ask(self, *packets: Packet, codec: Codec | None = None) -> None:
        """Send packets at once, and pass on what the board says a moment later."""
        for packet in packets:
            self.send((codec or self._codec).encode(packet))
        self.answer()

    def send(self, data: bytes) -> None:
        """Send bytes."""
        self.see("sent", data)
        self._session.receive(data, self.now)

    def answer(self) -> None:
        """Pass on what the board has said."""
        self.now += LATENCY
        said, self._said[:] = b"".join(self._said), []
        if said:
            self.see("received", said)
        self.now += 0.01

    def see(self, direction: Direction, data: bytes) -> None:
        """Show bytes to the spy, in pieces if there is chance."""
        while data:
            size = self._random.randint(1, len(data)) if self._random else len(data)
            self.passed += self.learner.feed(self.now, direction, data[:size])
            data = data[size:]

    def learnt(self) -> dict[str, Any]:
        """Return the verdict."""
        self.passed += self.learner.finish(self.now)
        return {fact.name: fact.value for fact in verdict(self.learner)}

    def text(self, name: str) -> str:
        """Return what people are told."""
        return next(fact.text for fact in verdict(self.learner) if fact.name == name)


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("mode", [0, 1])
def test_byte_order_and_mode(order: ByteOrder, mode: Literal[0, 1]) -> None:
    line = Line(Codec(order), BoardKind(mode=mode), Random(1))
    line.ask(QueryServoListRequest())
    line.now += 0.0 if mode else 0.5
    line.ask(TransmissionModeSettingRequest(1))
    for _ in range(5):
        line.ask(QueryServoListRequest())
    learnt = line.learnt()
    assert learnt["byte_order"] == order
    assert learnt["transmission_mode"] == {"at_first": mode, "set": [1], "echoed": [1]}
    assert line.text("transmission_mode").startswith("0 at first" if mode == 0 else "1 already")
    assert learnt.get("unanswered") == (None if mode else {"QueryServoList": 1})
    assert learnt["servo_ids"] == [1, 2, 3]
    assert learnt["under_way"] == 1
    times = learnt["response_time"]["by_request"]["QueryServoList"]
    assert times["count"] == 5 + mode
    assert times["p50"] == pytest.approx(LATENCY, rel=0.02)
    assert learnt["request_gap"]["p50"] == pytest.approx(0.01, rel=0.02)


def test_a_mode_that_is_set_again_and_again_takes_bounded_memory() -> None:
    line = Line(Codec())
    line.ask(QueryServoListRequest())
    for _ in range(100):
        line.ask(TransmissionModeSettingRequest(1))
    assert len(line.learner.modes) == len(line.learner.echoes) == 12
    twelve = ", ".join("1" * 12)
    assert line.text("transmission_mode") == (
        "1 already: the board answered before any mode was set; the program set "
        f"{twelve} and 88 more, the board said {twelve} and 88 more"
    )
    assert line.learnt()["transmission_mode"] == {"at_first": 1, "set": [1] * 12, "echoed": [1] * 12}


def test_a_program_that_tries_both_byte_orders() -> None:
    line = Line(Codec("big"))
    line.ask(TransmissionModeSettingRequest(1), codec=Codec("little"))
    line.ask(TransmissionModeSettingRequest(1))
    line.ask(QueryServoListRequest())
    assert line.learnt()["byte_order"] == "big"
    assert line.text("byte_order") == (
        "big: so are all 2 of the board's packets; the program also tried little, 1 times"
    )
    assert line.learnt()["transmission_mode"]["at_first"] is None


def test_a_mode_that_nobody_sets() -> None:
    line = Line(Codec())
    line.ask(QueryServoListRequest())
    assert line.learnt()["transmission_mode"] == {"at_first": 1, "set": [], "echoed": []}
    silent = Line(Codec(), BoardKind(mode=0))
    silent.ask(QueryServoListRequest())
    learnt = silent.learnt()
    assert learnt["byte_order"] is None
    assert "transmission_mode" not in learnt
    assert silent.text("byte_order") == ("unknown: the board sent no packet; 1 requests in little-endian")


@pytest.mark.parametrize("encoding", ["utf-8", "big5", "utf-16-le"])
def test_captions_and_the_order_of_an_import(encoding: str) -> None:
    line = Line(Codec("big", encoding))
    line.ask(ClearAllDataRequest())
    line.ask(WriteProjectIDRequest(77))
    line.ask(AddServoParameterRequest((ServoParameter(1, 3, "左手"), ServoParameter(2, -3, "右手"))))
    for at in (1, 2, 3):
        line.ask(AddActionRequest(at, "機器人跳舞", (Step(1, 30, 10),)))
    line.ask(AddMacroRequest(9, "招手", (MacroCommand(1),)))
    line.ask(AddJoystickTableRequest(4, "搖桿", (Button(7, "揮手", button_press_macro=9),)))
    line.ask(SetActiveJoystickTableRequest(4))
    line.ask(QueryProjectIDRequest())
    line.ask(QueryActionRequest(3))
    learnt = line.learnt()
    assert learnt["caption_encoding"] == {"encoding": encoding, "confidence": "certain"}
    assert line.text("import_order") == (
        "ClearAllData, WriteProjectID, AddServoParameter, AddAction x3, AddMacro, AddJoystickTable, "
        "SetActiveJoystickTable"
    )
    assert learnt["export_order"] == [["QueryProjectID", 1], ["QueryAction", 1]]
    assert (learnt["action_ids"], learnt["macro_ids"], learnt["table_ids"]) == ([1, 2, 3], [9], [4])
    assert (learnt["button_ids"], learnt["project_ids"]) == ([7], [77])


def test_what_no_document_says() -> None:
    line = Line(Codec("big"))
    line.ask(QueryMemorySizeRequest(), QueryServoListRequest())
    line.send(encode_frame(50020, b"\1\2", "big"))
    line.see("received", encode_frame(50021, b"", "big"))
    line.see("received", Codec("big").encode(QueryServoRequest(1))[:-1] + b"\xff" + b"noise")
    line.see("received", encode_frame(20011, b"\5\1", "big"))
    learnt = line.learnt()
    assert learnt["under_way"] == 2
    assert learnt["memory_response"] == [8]
    assert [(each["direction"], each["packet_id"], each["content"]) for each in learnt["unknown_packets"]] == [
        ("sent", 50020, "0102"),
        ("received", 50021, ""),
    ]
    assert learnt["damaged_received"] == 1
    assert learnt["noise_received"]["bytes"] >= 5


def test_what_comes_without_a_request() -> None:
    line = Line(Codec())
    line.see("received", encode_frame(40081, bytes(4) + b"\1", "little"))
    line.see("received", encode_frame(30131, bytes(4), "little"))
    assert line.learnt()["unsolicited"] == {"button event": 1, "QueryProjectIDResponse": 1}


def test_how_servos_are_stopped_and_moved() -> None:
    line = Line(Codec())
    line.ask(SetAngleUnitRequest(255, 1))
    line.ask(ExecuteActionRequest((Step(1, 500, 10),)))
    line.ask(SetServoParameterRequest(255, 0, 1))
    learnt = line.learnt()
    assert learnt["angle_unit"] == [{"servo_id": 255, "unit_type": 1, "count": 1}]
    assert learnt["stopping"] == [{"servo_id": 255, "is_start": 0, "is_hold": 1, "count": 1}]
    assert line.text("stopping") == "stop and hold all servos once"


def test_requests_that_are_repeated_or_lost() -> None:
    line = Line(Codec(), BoardKind(unsupported=("QueryMemorySize",)))
    line.ask(QueryMemorySizeRequest())
    line.now += 0.5
    line.ask(QueryMemorySizeRequest())
    line.ask(QueryServoListRequest())
    line.now += 5.0
    line.ask(QueryServoListRequest())
    learnt = line.learnt()
    assert learnt["unanswered"] == {"QueryMemorySize": 2}
    assert learnt["response_time"]["all"]["count"] == 2


def test_a_conversation_of_a_million_kinds_takes_bounded_memory() -> None:
    learner, codec, random = Learner(), Codec(), Random(3)
    for at in range(6000):
        learner.feed(
            at, "sent", codec.encode(AddActionRequest(at, f"{at}")) + encode_frame(60000 + at % 999, b"x", "little")
        )
        learner.feed(at, "sent", codec.encode(QueryActionRequest(random.randrange(10**9))))
    learner.feed(6000, "received", bytes(200_000))
    assert len(learner.captions) <= 5000
    assert len(learner.ids["action_id"]) <= 1000
    assert len(learner.unknown) <= 50
    assert len(learner.writes.runs) + len(learner.reads.runs) <= 400
    assert learner.noise["received"] == 200_000
    assert verdict(learner)
