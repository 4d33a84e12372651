"""Nothing private is in a report: its bytes are searched, unpacked and decoded.

Module: servolink.recorder.private_text.
"""

from __future__ import annotations

import base64
import io
import json
import random
import zipfile
from pathlib import Path

import msgspec
import pytest

from servolink.errors import RecordingError
from servolink.protocol import (
    ActionEntry,
    AddActionRequest,
    AddJoystickTableRequest,
    Button,
    ByteOrder,
    Codec,
    FrameParser,
    Packet,
    QueryActionListResponse,
    QueryActionResponse,
    QueryServoParameterResponse,
    SendDummyDataRequest,
    ServoParameter,
    Step,
)
from servolink.recorder import BugReport
from servolink.recorder.bug_report import blank_recording, blank_stream
from servolink.recorder.channels import (
    TOPICS,
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    RecordedServo,
    ServosRead,
    Wire,
    decode,
    encode,
)
from servolink.recorder.private_text import PrivateText
from servolink.recorder.reading import Recording
from tests.recorder.files import write

PRIVATE = "Zyx-Geheim"
PACKETS: list[Packet] = [
    AddActionRequest(3, PRIVATE, (Step(1, 30, 50),)),
    QueryActionResponse(3, PRIVATE, (Step(1, 30, 50),)),
    QueryActionListResponse((ActionEntry(1, PRIVATE), ActionEntry(2, "Wave"))),
    QueryServoParameterResponse((ServoParameter(1, 2, PRIVATE),)),
    AddJoystickTableRequest(1, PRIVATE, (Button(1, PRIVATE, 1),)),
    SendDummyDataRequest(PRIVATE.encode()),
]


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
def test_captions_are_blanked_in_frames_of_the_same_length(order: ByteOrder, encoding: str) -> None:
    codec = Codec(order, encoding)
    frames = [codec.encode(packet) for packet in PACKETS]
    blank = blank_stream(b"".join(frames), order)
    assert len(blank) == sum(map(len, frames))
    assert PRIVATE.encode(encoding)[:6] not in blank
    parser = FrameParser(order)
    found = [codec.decode(*frame) for frame in parser.feed(blank)]
    assert [type(packet) for packet in found] == [type(packet) for packet in PACKETS]
    assert sum(parser.skipped.values()) == 0
    assert isinstance(found[0], AddActionRequest)
    assert (found[0].action_id, found[0].steps) == (3, (Step(1, 30, 50),))


def test_what_is_in_no_intact_frame_is_blanked_whole() -> None:
    codec, chance = Codec(), random.Random(1)
    stream = b"".join(map(codec.encode, PACKETS))
    for _ in range(100):
        damaged = bytearray(stream)
        for _ in range(chance.randrange(1, 5)):
            kind, at = chance.randrange(3), chance.randrange(len(damaged))
            if kind == 0:
                damaged[at] ^= 1 << chance.randrange(8)
            elif kind == 1:
                del damaged[at : at + chance.randrange(40)]
            else:
                damaged[at:at] = PRIVATE.encode()
        blank = blank_stream(bytes(damaged), "little")
        assert len(blank) == len(damaged)
        assert PRIVATE.encode() not in blank


def test_rest_behind_the_end_of_a_caption_is_blanked() -> None:
    frame = bytearray(Codec().encode(AddActionRequest(3, "x")))
    frame[20:30] = PRIVATE.encode()
    frame[-1] = sum(frame[:-1]) & 0xFF
    assert PRIVATE.encode() not in blank_stream(bytes(frame), "little")


STATE = RecordedServo(1, 30.0, "degree", 3, 250, 1, is_start=True, is_hold=True, caption=PRIVATE)
FIELDS = {"action_id": 3, "action_caption": PRIVATE, PRIVATE: 1, "steps": [{"servo_id": 1, PRIVATE: PRIVATE}, PRIVATE]}
WIRE = Codec().encode(AddActionRequest(3, PRIVATE, (Step(1, 30, 50),)))
MESSAGES: list[tuple[float, Message]] = [
    (0.0, Event("program", "joined", PRIVATE, PRIVATE, text=f"tcp, {PRIVATE}")),
    (0.1, Event("mark", f"mark {PRIVATE}", PRIVATE, text=f"{PRIVATE} twitches")),
    (0.2, Wire("sent", WIRE[:20], 0.2)),
    (0.3, Wire("received", b"noise" + PRIVATE.encode(), 0.3)),
    (0.4, Wire("sent", WIRE[20:25], 0.4)),
    (0.5, Wire("sent", WIRE[25:], 0.5)),
    (0.6, PacketSeen("sent", 30030, "AddActionRequest", FIELDS, 50)),
    (0.7, PacketSeen("received", 7, PRIVATE, {PRIVATE: PRIVATE}, 50, f"no {PRIVATE}", data=PRIVATE.encode())),
    (0.8, PacketSeen("received", noise=9, data=PRIVATE.encode())),
    (
        0.9,
        CommandDone("AddActionRequest", FIELDS, "failed", 1.0, PRIVATE, PRIVATE, PRIVATE, f"'{PRIVATE}' is gone"),
    ),
    (1.0, CommandDone(PRIVATE, {"data": PRIVATE.encode().hex()}, "sent")),
    (1.1, ServosRead((STATE,))),
    (1.2, ProblemFound("line", f"{PRIVATE} is gone", PRIVATE, 3)),
]
ABOUT = {"version": PRIVATE, "started": PRIVATE * 9, "board": PRIVATE, "through": "hub", "caption_encoding": PRIVATE}
ABOUT["hz"] = PRIVATE


def in_it(packed: bytes, folder: Path) -> bytes:
    """Return all bytes of a report: as they are, unpacked, and the bytes of messages decoded, joined as they passed."""
    found = [packed]
    with zipfile.ZipFile(io.BytesIO(packed)) as archive:
        for name in archive.namelist():
            found += [name.encode(), archive.read(name)]
        path = archive.extract(BugReport.RECORDING, folder / "unpacked")
    wires = {"sent": b"", "received": b""}
    recording = Recording(path)
    found.append(repr(recording.about).encode())
    for entry in recording.entries():
        found += [repr(entry).encode(), getattr(entry.message, "data", b"")]
        if isinstance(entry.message, Wire):
            wires[entry.message.direction] += entry.message.data
    assert recording.remarks == []
    return b"\n".join([*found, *wires.values()])


@pytest.mark.parametrize("secret", [PRIVATE, 'O\'Neill said "x"', "Ünï=cödé", "a\\b/c", "4711-ABC-99", "knie\nlinks"])
def test_nothing_private_is_in_a_report(secret: str, tmp_path: Path) -> None:
    def planted(text: str) -> str:
        return text.replace(PRIVATE, json.dumps(secret)[1:-1])

    path = write(tmp_path / "out.mcap", MESSAGES, about=ABOUT, chunk_size=99)
    if secret != PRIVATE:
        messages = [
            (seconds, decode(TOPICS[type(message)], planted(encode(message).decode()).encode()))
            for seconds, message in MESSAGES
        ]
        path = write(
            tmp_path / "other.mcap",
            messages,
            about={name: text.replace(PRIVATE, secret) for name, text in ABOUT.items()},
        )
    private = PrivateText()
    files = {BugReport.RECORDING: blank_recording(path, private)}
    packed = BugReport({"text": private.blank(f"a {secret}")}, files).packed
    found = in_it(packed, tmp_path).lower()
    for form in (
        secret,
        json.dumps(secret)[1:-1],
        secret.encode().hex(),
        base64.b64encode(secret.encode()).decode()[:-4],
    ):
        assert form.lower().encode() not in found
    if secret == PRIVATE:
        assert b"geheim" not in found


def test_rest_of_a_recording_stays_as_it_was(tmp_path: Path) -> None:
    path = write(tmp_path / "out.mcap", MESSAGES)
    (tmp_path / "blank.mcap").write_bytes(blank_recording(path, PrivateText()))
    recording = Recording(tmp_path / "blank.mcap")
    found = [(round(entry.seconds, 6), entry.message) for entry in recording.entries()]
    assert [(seconds, type(message)) for seconds, message in found] == [(at, type(one)) for at, one in MESSAGES]
    messages = [message for _, message in found]
    assert [len(one.data) for one in messages if isinstance(one, Wire)] == [20, 5 + len(PRIVATE), 5, len(WIRE) - 25]
    command = messages[9]
    assert isinstance(command, CommandDone)
    assert (command.outcome, command.who, command.lease, command.reason) == (
        "failed",
        "program 1",
        "program 1",
        "*** is gone",
    )
    blank = "x" * len(PRIVATE)
    assert command.fields == {"action_id": 3, "action_caption": blank, "steps": [{"servo_id": 1}, blank]}
    assert messages[1] == Event("mark", "mark", "program 1")
    assert messages[11] == ServosRead((msgspec.structs.replace(STATE, caption=blank),))


def test_only_the_last_minutes_are_in_it(tmp_path: Path) -> None:
    path = write(
        tmp_path / "out.mcap", [(float(at), Event("button", "press", button_id=at)) for at in range(0, 900, 100)]
    )
    (tmp_path / "blank.mcap").write_bytes(blank_recording(path, PrivateText()))
    recording = Recording(tmp_path / "blank.mcap")
    assert [getattr(entry.message, "button_id", 0) for entry in recording.entries()] == [500, 600, 700, 800]


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("cannot open /dev/ttyUSB0: busy", "cannot open *** busy"),
        ("see C:\\Users\\anna\\x and ~/x", "see *** and ***"),
        ("tcp://robot.local:9000 is silent", "*** is silent"),
        ("serial 1A2B3C4D5E of 12345678", "serial *** of ***"),
        ("mail anna@example.org", "mail ***"),
        ("no answer in 3.0 s (12 bytes)", "no answer in 3.0 s (12 bytes)"),
        ("can't open 'it's mine' now", "can*** now"),
        ("Kniegelenk hört nicht", "Kniegelenk h***rt nicht"),
        ("rex is gone, REX", "*** is gone, ***"),
        ("", ""),
    ],
)
def test_texts_lose_what_is_private(text: str, left: str) -> None:
    assert PrivateText(["rex"]).blank(text) == left


def test_names_of_this_machine_are_private(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "annas-laptop.example")
    monkeypatch.setattr("getpass.getuser", lambda: "anna")
    assert PrivateText().blank("annas-laptop of anna, groups of Anna") == "*** of ***, groups of ***"


def test_a_home_is_private_even_if_its_user_has_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> str:
        raise ModuleNotFoundError

    monkeypatch.setattr("getpass.getuser", fail)
    monkeypatch.setattr(Path, "home", lambda: Path("D:/Robots of Anna"))
    assert PrivateText().blank("kept under D:/Robots of Anna") == "kept under ***"


def zipped(name: str, content: bytes, kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", kind) as archive:
        archive.writestr(zipfile.ZipInfo(name), content, kind)  # of a fixed date: these bytes name tests
    return packed.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"PK\x03\x04nonsense", "cannot be read as a report"),
        (zipped("x.json", b"{}"), "is not a report: report.json is missing"),
        (zipped(BugReport.FACTS, b"[]"), "holds no object"),
        (zipped(BugReport.FACTS, b"{"), "cannot be read as a report"),
        (zipped(BugReport.FACTS, b"[" * 99_999), "cannot be read as a report"),
        (zipped(BugReport.FACTS, bytes(30_000_000)), "report.json is larger than 1 MiB"),
        (zipped(BugReport.FACTS, b"{}", zipfile.ZIP_LZMA), "compressed in a way not used in reports"),
        (
            zipped(BugReport.FACTS, b"{}").replace(BugReport.FACTS.encode(), b"report.jsom", 1),
            "cannot be read as a report",
        ),
    ],
)
def test_other_zips_are_refused(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.zip"
    path.write_bytes(content)
    assert BugReport.is_in(path)
    with pytest.raises(RecordingError, match=message):
        BugReport.read(path)


def test_damage_in_a_report_is_an_error_or_changes_nothing(tmp_path: Path) -> None:
    """A date of the zip, for instance, is not looked at."""
    path, whole = tmp_path / "x.zip", BugReport({"x": list(range(300))}, {}).packed
    path.write_bytes(whole)
    content, errors = BugReport.read(path).files, 0
    for bit in range(0, 8 * len(whole), 7):  # each byte, and each bit of some
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            assert BugReport.read(path).files == content
        except RecordingError:
            errors += 1
    assert errors > len(whole) / 2


def test_missing_file_is_no_zip(tmp_path: Path) -> None:
    assert not BugReport.is_in(tmp_path / "none")
    with pytest.raises(RecordingError, match="cannot be read as a report"):
        BugReport.read(tmp_path / "none")
