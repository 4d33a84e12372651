"""A folder with a board, projects and other files in it, in which every text is hostile, or none is."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

import pytest

from servolink.boards import announced
from servolink.errors import EncodeError
from servolink.project import Figure, Project, ProjectFile
from servolink.protocol import (
    ACTION,
    HEADER_SIZE,
    MACRO,
    SERVO_PARAMETER,
    TABLE,
    Action,
    AddActionRequest,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    Codec,
    JoystickTable,
    Macro,
    MacroCommand,
    Packet,
    ServoParameter,
    Step,
    decode_caption,
    encode_frame,
)
from servolink.recorder import CommandDone, Event, Message, PacketSeen, ProblemFound, RecordedServo, ServosRead
from servolink.transports import DeviceInfo, PortIdentity
from servolink.virtual import AnyType, BoardKind, VirtualBoard, save_state
from tests.proofs.hostile.corpus import ONE_OF_EACH, PAYLOADS, Payload
from tests.recorder.files import write as write_recording

SERVOS = 240
_SERVOS = {"all": SERVOS, "few": 64}
"""By board; a table of all servos takes long to draw."""
_MEMORY = 400_000
_GIVEN = ("mixed", "noise", "stream", "script", "mcap", "report")
_MARK = "?" * 32
_UNESCAPED = "/[]:$()'\"\\"
_IN_FILES = "x\x1b[2J\x1b]0;o\x07\r\n\t\x7f\x9b31m\u202e\u2066\u200b\u2028\u3164[bold]:bomb:%00&$(x)=1'\"\\\udcff\udc9b"
_IN_ADDRESSES = "x\x9b31m\x85\u202e\u2066\u200b\u2028\u3164[bold]:bomb:$(x)'\"\\\udcff\udc9b"
"""An address is refused if C0 controls are in it."""


@dataclass(frozen=True)
class World:
    """Where commands are run, and the texts in it."""

    folder: Path
    captions: Sequence[bytes]
    """One for each payload."""
    name: str
    """Of files."""
    place: str
    """The same in addresses."""

    @classmethod
    def hostile(cls, folder: Path) -> World:
        """Make one in which every text is hostile."""
        return cls(folder, [payload.caption for payload in PAYLOADS], _IN_FILES, _IN_ADDRESSES)

    @classmethod
    def harmless(cls, folder: Path) -> World:
        """Make the same one with nothing but letters and numbers."""
        return cls(folder, [f"text {at}".encode() for at in range(len(PAYLOADS))], "x", "x")

    def copied(self, folder: Path) -> World:
        """Copy what was built."""
        shutil.copytree(self.folder, folder)
        return replace(self, folder=folder)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Be a user whose own folders are here, and who has a device that is called as everything here is."""
        with pytest.MonkeyPatch.context() as patch:
            for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_RUNTIME_DIR"):
                folder = self.path(name)
                folder.mkdir(mode=0o700, exist_ok=True)
                patch.setenv(name, str(folder))
            name = _only_text(self.name)
            with announced(
                DeviceInfo(f"serial:///dev/{_only_text(self.place)}", name, PortIdentity(serial_number=name), name)
            ):
                yield

    def url(self, board: str) -> str:
        """Return the address of a board; what need not be escaped in it is not."""
        state = quote(os.fsencode(self._board(board)), safe=_UNESCAPED).replace(quote("\u202e\u2066"), "\u202e\u2066")
        return f"virtual://?servos={_SERVOS[board]}&memory={_MEMORY}&state={state}"

    @property
    def written(self) -> Iterator[Path]:
        """The files that commands have written."""
        given = {self.path(suffix) for suffix in _GIVEN}
        return (path for path in self.folder.rglob("*") if path.is_file() and path not in given)

    def path(self, suffix: str) -> Path:
        """Return the path of a file."""
        return self.folder / f"{self.name}.{suffix}"

    def arguments(self, pattern: str) -> list[str]:
        """Return the words of `pattern` with the names of this world for what is in braces.

        `{all}` and `{few}` are boards, `{name}`, `{place}` and `{text}` the names of files, the last two without
        control characters; any other word is the suffix of a file.
        """
        names = _Names(self)
        return [word.format_map(names) for word in pattern.split()]

    def build(self) -> None:
        """Write all files."""
        self.folder.mkdir()
        few = [self.captions[PAYLOADS.index(payload)] for payload in ONE_OF_EACH]
        self._save_board("all", self.captions)
        self._save_board("few", few)
        texts = [decode_caption(caption, "utf-8") for caption in self.captions]
        self._write("project", ProjectFile(_project(texts)).text().encode())
        self._write(
            "other", ProjectFile(_project([decode_caption(caption, "utf-8") for caption in few])).text().encode()
        )
        self._write("allowed", ProjectFile(_project([texts[at] for at in _ALLOWED][::8])).text().encode())
        self._write("body", ProjectFile(_harmless_records(), figure=_figure(texts)).text().encode())
        self._write("mixed", json.dumps({"schema": 1, self.name: texts}).encode())
        self._write("noise", b"\n".join(self.captions))
        frames = [
            encode_frame(AddActionRequest.packet_id, _content(AddActionRequest(1, _MARK), caption), "little")
            for caption in self.captions
        ]
        self._write("stream", b"".join(map(bytes.__add__, frames, self.captions)))
        self._write("hex", "\n".join(frame.hex() for frame in frames).encode())
        self._save_recording([*texts[:16], self.name])
        self._write("script", b"1 press 3\n2 dance " + self.name.encode("utf-8", "surrogateescape"))

    def _board(self, name: str) -> Path:
        return self.folder / f"{self.place}.{name}.board"

    def _write(self, suffix: str, content: bytes) -> None:
        self.path(suffix).write_bytes(content)

    def _save_board(self, name: str, captions: Sequence[bytes]) -> None:
        board = VirtualBoard(_SERVOS[name], kind=BoardKind(memory=_MEMORY))
        board.storage.project_id = 5
        for kind, declared in _STORED.items():
            records = {at: _content(declared(at), caption) for at, caption in enumerate(captions, 1)}
            assert board.storage.put(kind, records)
        every = (Button(at, _MARK, 1) for at in range(1, len(captions) + 1))
        table = Codec().encode(AddJoystickTableRequest(1, "all", tuple(every)))[HEADER_SIZE:-1]
        for caption in captions:
            table = table.replace(_MARK.encode(), caption.ljust(32, b"\0"), 1)
        parameters = {
            at: _content(AddServoParameterRequest((ServoParameter(at, 1, _MARK),)), caption)[2:]
            for at, caption in enumerate(captions[:SERVOS], 1)
        }
        assert board.storage.put(TABLE, {1: table})
        assert board.storage.put(SERVO_PARAMETER, parameters)
        save_state(board, self._board(name))

    def _save_recording(self, texts: Sequence[str]) -> None:
        """Write a recording in which each text stands wherever a text can stand."""
        texts = [text.encode("utf-8", "replace").decode() for text in texts]
        messages: list[tuple[float, Message]] = []
        for at, text in enumerate(texts):
            fields = {"action_id": 1, "action_caption": text, text: text, "steps": [text]}
            state = RecordedServo(at, 1.0, "degree", 3, 4, 1, is_start=True, is_hold=True, caption=text)
            messages += [
                (at, CommandDone("AddActionRequest", fields, "rejected", 0.1, text, text, text, text)),
                (at, PacketSeen("sent", 30030, "AddActionRequest", fields, 20)),
                (at, PacketSeen("received", 30031, text, {text: text}, 20, error=text)),
                (at, ServosRead((state,))),
                (at, Event("program", text, text, text, text=text)),
                (at, ProblemFound("line", text, text, 3)),
            ]
        name = texts[-1]
        about = {"version": name, "started": name, "board": name, "through": "hub", "byte_order": name, "hz": name}
        write_recording(self.path("mcap"), messages, about=about)


_STORED: dict[AnyType, Callable[[int], Packet]] = {
    ACTION: lambda at: AddActionRequest(at, _MARK, (Step(at % SERVOS + 1, 10, 5),)),
    MACRO: lambda at: AddMacroRequest(at, _MARK, (MacroCommand(at, total_interval=50),)),
    TABLE: lambda at: AddJoystickTableRequest(at, _MARK, (Button(1, _MARK, at),)),
}


class _Names(dict[str, str]):
    """What stands for a word in braces."""

    def __init__(self, world: World) -> None:
        super().__init__(all=world.url("all"), few=world.url("few"), name=world.name, place=world.place)
        self["text"] = _only_text(world.place)
        self._world = world

    def __missing__(self, suffix: str) -> str:
        return str(self._world.path(suffix))


def _only_text(name: str) -> str:
    """Return `name` without the bytes that are none, which nothing but a file's name can hold."""
    return name.encode("utf-8", "ignore").decode()


def _content(packet: Packet, caption: bytes) -> bytes:
    """Return the content of a packet with `caption` for each mark in it."""
    return Codec().encode(packet)[HEADER_SIZE:-1].replace(_MARK.encode(), caption.ljust(32, b"\0"))


def _is_allowed(payload: Payload) -> bool:
    """Tell whether this library would write it as a caption by itself."""
    try:
        Codec().encode(AddActionRequest(1, decode_caption(payload.caption, "utf-8")))
    except EncodeError:
        return False
    return True


_ALLOWED = [at for at, payload in enumerate(PAYLOADS) if _is_allowed(payload)]


def _figure(texts: Sequence[str]) -> Figure:
    """Return a lamp on the floor whose parts have the first and the last of `texts` as names."""
    foot, arm = (text.encode("utf-8", "replace").decode()[:63] for text in (texts[0], texts[-1]))
    return Figure.from_json(
        {
            "figure": 1,
            "name": foot,
            "view": {},
            "joints": [
                {"id": foot, "shapes": [{"box": [100, 20, 100]}], "mass": 0.3},
                {"id": f"{arm}2", "parent": foot, "servo": 1, "at": [0, 10, 0], "length": 90, "along": [0, 1, 0]},
            ],
            "body": {"bolted": False},
        }
    )


def _harmless_records() -> Project:
    lean = Action(1, "lean", (Step(1, 90, 1),))
    return Project(6, (), (lean,), (Macro(1, "lean", (MacroCommand(1, total_interval=100),)),), (), 0)


def _project(texts: Sequence[str]) -> Project:
    numbered = list(enumerate(texts, 1))
    return Project(
        6,
        tuple(ServoParameter(at, 1, text) for at, text in numbered[:SERVOS]),
        tuple(Action(at, text, (Step(at % SERVOS + 1, 10, 5),)) for at, text in numbered),
        tuple(Macro(at, text, (MacroCommand(at, total_interval=50),)) for at, text in numbered),
        tuple(JoystickTable(at, text, (Button(1, text, at),)) for at, text in numbered),
        1,
    )
