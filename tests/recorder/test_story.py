"""The story of a recording names who asked for what, what came of it, and what is missing.

Modules: servolink.recorder.conversation, servolink.recorder.recording_summary, servolink.recorder.round_trips.
"""

from __future__ import annotations

import pytest

from servolink.recorder.channels import (
    TOPICS,
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    RecordedServo,
    ServosRead,
)
from servolink.recorder.reading import Entry
from servolink.recorder.recording_summary import Summary
from servolink.recorder.round_trips import Times
from servolink.recorder.story import Story, StoryRow

ASK = PacketSeen("sent", 20020, "QueryServoRequest", {"servo_id": 3}, 10)
ANSWER = PacketSeen("received", 20021, "QueryServoResponse", {"servos": [{"servo_id": 3}]}, 30)


def entries(*messages: tuple[float, Message]) -> list[Entry[Message]]:
    return [Entry(seconds, 0, TOPICS[type(message)], message) for seconds, message in messages]


def told(*messages: tuple[float, Message], hz: float = 0.0, packets: bool = False) -> list[StoryRow]:
    return list(Story(hz=hz, packets=packets).tell(entries(*messages)))


@pytest.mark.parametrize(
    ("message", "who", "text"),
    [
        (CommandDone("SetAngleUnitRequest", {"servo_id": 3}, "answered", 0.0021, "studio"), "studio", "in 2.1 ms"),
        (CommandDone("AddActionRequest", {"action_caption": "x"}, "rejected", 0.5), "program", "REJECTED by the board"),
        (CommandDone("AddActionRequest", {}, "refused", who="a", lease="b", reason="no"), "a", "no (the lease had b)"),
        (
            CommandDone(
                "ExecuteActionRequest",
                {"steps": [{"servo_id": at, "degree": 9, "interval": 50} for at in range(20)]},
                "sent",
            ),
            "program",
            "15=9 and 4 more in 500 ms, sent",
        ),
        (CommandDone("ExecuteActionRequest", {"steps": [{"servo_id": "x"}]}, "sent"), "program", "steps: 1, sent"),
        (CommandDone("X", {"list": [1, 2], "none": []}, "unknown", 3.0), "program", "list=1,2 none=none, OUTCOME"),
        (CommandDone("X", {"text": "y" * 9999}, "sent"), "program", "..."),
        (Event("button", "press", button_id=7), "board", "button 7 press"),
        (Event("mark", "mark", text="here"), "mark", "mark: here"),
        (Event("lease", "taken", "studio"), "studio", "lease taken"),
        (PacketSeen("received", noise=3, data=b"abc"), "board", "3 bytes of noise: 61 62 63"),
        (PacketSeen("sent", 7, error="no packet has the id 7"), "program", "packet 7 cannot be read: no packet"),
        (ProblemFound("dropped", "slow", "/servos", 9), "recorder", "slow (9 messages of /servos are missing)"),
    ],
)
def test_line(message: Message, who: str, text: str) -> None:
    (line,) = told((1.5, message))
    assert (line.seconds, line.who) == (1.5, who)
    assert text in line.text
    assert len(line.text) < 600


def test_equal_lines_in_a_row_are_told_in_short() -> None:
    move = CommandDone("ExecuteActionRequest", {}, "sent", who="wave")
    lines = told(*((at / 10, move) for at in range(30)), (3.0, Event("mark", "mark")), (3.1, move), (3.2, move))
    assert [line.text for line in lines] == [
        "ExecuteAction, sent",
        "29 more like it, until 2.900 s",
        "mark",
        *["ExecuteAction, sent"] * 2,
    ]


def test_silence_and_gaps_are_told() -> None:
    story = Story(hz=20)
    lines = list(story.tell(entries((0.0, ServosRead(())), (0.1, ASK), (2.5, ANSWER), (3.0, ServosRead(())), (4, ASK))))
    assert [(line.seconds, line.text) for line in lines] == [
        (2.5, "nothing came in the last 2.4 s"),
        (3.0, "no reading of the servos in the last 3.0 s"),
    ]
    assert all(line.is_problem for line in lines)
    assert story.silences.total() == 2


def test_packets_are_told_with_their_responses() -> None:
    press = PacketSeen("received", 40081, "ButtonEventResponse", {"button_id": 1, "event": 0}, 11)
    move = PacketSeen("sent", 20050, "ExecuteActionRequest", {"steps": []}, 10)
    lines = told((0.0, ASK), (0.004, ANSWER), (1.0, ASK), (1.1, press), (1.2, move), packets=True)
    assert [line.text for line in lines] == [
        "QueryServo servo_id=3, answered in 4.0 ms: servos: 1",
        "ButtonEvent button_id=1 event=0, without a request",
        "ExecuteAction steps=none, sent",
        "QueryServo servo_id=3, NOT ANSWERED",
    ]


def test_figures() -> None:
    summary = Summary()
    state = RecordedServo(3, 10.0, "degree", 5, 300, 1, is_start=True, is_hold=True, caption="hip")
    warmer = RecordedServo(3, -4.0, "degree", 9, 280, 1, is_start=True, is_hold=True)
    passed = entries(
        (0.0, ASK),
        (0.01, ANSWER),
        (1.0, ASK),
        (5.0, ANSWER),
        (5.1, ServosRead((state,), 2)),
        (5.2, ServosRead((warmer,))),
        (5.3, CommandDone("AddActionRequest", {}, "unknown", 3.0, "studio")),
        (5.4, PacketSeen("received", noise=4)),
        (5.5, PacketSeen("received", 7, error="x")),
        (5.6, Event("connection", "lost")),
        (5.7, ProblemFound("line", "x")),
    )
    assert list(summary.over(passed)) == passed
    close = pytest.approx(0.01, rel=0.01)
    assert summary.as_dict() == {
        "seconds": 5.7,
        "messages": {"/packets": 6, "/servos": 2, "/commands": 1, "/events": 1, "/problems": 1},
        "requests": {
            "QueryServoRequest": {"sent": 2, "unanswered": 1, "seconds": {"p50": close, "p99": close, "longest": 0.01}}
        },
        "outcomes": {"unknown": 1},
        "programs": {"studio": 1},
        "problems": {
            "requests not answered": 1,
            "commands of unknown outcome": 1,
            "noise on the line": 1,
            "packets that cannot be read": 1,
            "losses of the connection": 1,
            "troubles on the line": 1,
        },
        "noise_bytes": 4,
        "missed_readings": 2,
        "servos": {
            3: {
                "caption": "hip",
                "angles": [-4.0, 10.0],
                "most_current_raw": 9,
                "most_temperature_raw": 300,
                "doubts": [],
            }
        },
    }


def test_percentiles_are_right_to_one_percent() -> None:
    times = Times()
    assert times.percentile(50) is None
    for number in range(1, 1001):
        times.add(number / 1000)
    for percent in (1, 50, 90, 99, 100):
        assert times.percentile(percent) == pytest.approx(percent / 100, rel=0.011)
    times.add(0.0)
    assert times.percentile(0.001) == pytest.approx(1e-6, rel=0.01)
