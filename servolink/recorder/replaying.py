"""Board with responses from a recording, `replay://out.mcap`: for regression tests, and to examine a fault again.

A recording begins and ends anywhere in a session, and two runs of a program never ask for the state of the board
equally often. So the program must send the same commands in the same order, while queries get the responses recorded
at the same point.
"""

from __future__ import annotations

import asyncio
from collections import deque
from pathlib import Path
from typing import NoReturn

from servolink.errors import ConnectionLost, OpenError, RecordingError
from servolink.protocol import (
    ExecuteActionRequest,
    Frame,
    FrameParser,
    Packet,
    QueryActiveJoystickTableRequest,
    QueryActiveJoystickTableResponse,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    QueryServoResponse,
    Response,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    packet_to_json,
)
from servolink.recorder.conversation import Asked, Conversation, Said, decoded, read_conversation
from servolink.recorder.mcap_reader import MAGIC
from servolink.recorder.reading import Recording
from servolink.recorder.story import asked as in_words
from servolink.support import call_at, open_file
from servolink.transports import Address, BaseTransport, ReplayTransport, Transport


class RecordedBoardTransport(BaseTransport):
    """A connection to the board in an MCAP file."""

    is_recorded = True

    def __init__(self, path: str | Path, *, speed: float = 1.0, url: str = "") -> None:
        """Play the recording at `path`, with times divided by `speed`; 0 answers at once."""
        super().__init__(url or f"replay://{path}")
        self._path = Path(path)
        self._speed = speed
        self._found: Conversation | None = None
        self._parser = FrameParser()
        self._answers: dict[Frame, _RecordedAnswers] = {}
        self._commands: list[Asked] = []
        self._done = 0  # number of commands sent again
        self._unasked: deque[tuple[int, Said]] = deque()
        self._coming: deque[tuple[float, bytes]] = deque()
        self._timer: asyncio.Handle | None = None

    @property
    def is_finished(self) -> bool:
        """Whether every command of the recording was sent again."""
        return self._done == len(self._commands)

    async def _open(self) -> None:
        """Read the recording. Raise OpenError for a recording impossible to replay."""
        try:
            self._found = found = read_conversation(Recording(self._path))
        except RecordingError as error:
            raise OpenError(str(error)) from error
        self._parser = FrameParser(found.codec.byte_order)
        for asked in found.asked:
            if asked.is_command:
                self._commands.append(asked)
            else:
                self._answers.setdefault(asked.frame, _RecordedAnswers()).add(asked)
        self._unasked = deque(found.unasked)
        self._play_unasked(0.0)

    def _send(self, data: bytes) -> None:
        """Answer packets of the program. Raise ConnectionLost for commands different from the recording."""
        assert self._found is not None  # noqa: S101 - it is open
        for frame in self._parser.feed(data):
            packet = decoded(self._found.codec, frame)
            if packet is not None and not Asked(0, 0.0, frame, packet).is_command:
                self._answer(frame, packet)
            else:
                self._obey(frame, packet)

    async def _close(self) -> None:
        """Free nothing: a recording holds no port."""

    def _abort(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    # --- packets of the program ----------------------------------------------------------------------------------

    def _answer(self, frame: Frame, packet: Packet) -> None:
        """Send the recorded response to a query: the response at this point of the recording, or the nearest."""
        assert self._found is not None  # noqa: S101 - it is open
        if known := self._answers.get(frame):
            after = self._commands[self._done - 1].number if self._done else -1
            asked = known.next(after)
            if asked.answer is not None:
                self._say(asked.answer.data, asked.answer.seconds - asked.seconds)
        elif isinstance(packet, QueryServoListRequest):  # also of a recording by a program that did not ask for it
            self._say(self._found.codec.encode(QueryServoListResponse(self._servo_ids())), 0.0)
        elif (response := _usual(packet)) is not None:
            self._say(self._found.codec.encode(response, unchecked=True), 0.0)
        else:
            self._differ(f"the recording has no response to {_words(packet)}")

    def _servo_ids(self) -> tuple[int, ...]:
        """Return the ids of the servos that are reported or moved in the recording."""
        assert self._found is not None  # noqa: S101 - it is open
        ids: set[int] = set()
        for asked in self._found.asked:
            if isinstance(asked.packet, ExecuteActionRequest):
                ids |= {step.servo_id for step in asked.packet.steps}
            elif isinstance(asked.packet, QueryServoRequest) and asked.answer is not None:
                for frame in FrameParser(self._found.codec.byte_order).feed(asked.answer.data):
                    if isinstance(found := decoded(self._found.codec, frame), QueryServoResponse):
                        ids |= {state.servo_id for state in found.servos}
        return tuple(sorted(ids))

    def _obey(self, frame: Frame, packet: Packet | None) -> None:
        """Take the next command, equal to the recorded command. Either program may have repeated the latest command."""
        latest = self._commands[self._done - 1] if self._done else None
        if latest is not None and getattr(latest.packet, "repeatable", False):
            if frame == latest.frame and self._next_frame != frame:
                self._respond(latest)
                return
            while frame != latest.frame == self._next_frame:
                self._done += 1
        if self.is_finished:
            self._differ(f"nothing more was sent in the recording, got {_words(packet)}")
        expected = self._commands[self._done]
        if frame != expected.frame:
            self._differ(f"at {expected.seconds:.3f} s: expected {_words(expected.packet)}, got {_words(packet)}")
        self._done += 1
        self._respond(expected)
        self._play_unasked(expected.seconds)

    @property
    def _next_frame(self) -> Frame | None:
        return None if self.is_finished else self._commands[self._done].frame

    def _differ(self, how: str) -> NoReturn:
        error = ConnectionLost(f"{self.url}: the program differs from the recording: {how}")
        self._lose(error)
        raise error

    # --- packets of the board ------------------------------------------------------------------------------------

    def _respond(self, asked: Asked) -> None:
        if asked.answer is not None:
            self._say(asked.answer.data, asked.answer.seconds - asked.seconds)

    def _play_unasked(self, since: float) -> None:
        """Send packets without a request up to the next command, with the recorded delays after the latest command."""
        while self._unasked and self._unasked[0][0] <= self._done:
            _, said = self._unasked.popleft()
            self._say(said.data, said.seconds - since)

    def _say(self, data: bytes, seconds: float) -> None:
        now = asyncio.get_running_loop().time()
        self._coming.append((now + max(0.0, seconds) / self._speed if self._speed else now, data))
        self._arm()

    def _arm(self) -> None:
        if self._timer is None and self._coming:
            loop, due, play = asyncio.get_running_loop(), self._coming[0][0], self._deliver_next
            self._timer = call_at(loop, due, play) if due > loop.time() else loop.call_soon(play)

    def _deliver_next(self) -> None:
        self._timer = None
        _, data = self._coming.popleft()
        self._deliver(data)
        if self._stage != "ended":
            self._arm()


class _RecordedAnswers:
    """Responses to a query, in order."""

    def __init__(self) -> None:
        self._all: list[Asked] = []
        self._at = 0

    def add(self, asked: Asked) -> None:
        self._all.append(asked)

    def next(self, after: int) -> Asked:
        """Return the next query after the frame `after`, or else the last query with a response."""
        while self._at < len(self._all) and self._all[self._at].number < after:
            self._at += 1
        if self._at < len(self._all):
            self._at += 1
            return self._all[self._at - 1]
        answered = (asked for asked in reversed(self._all) if asked.answer is not None)
        return next(answered, self._all[-1])


def _usual(packet: Packet) -> Response | None:
    """Return a response to a usual first query of a connection, for a recording begun later."""
    match packet:
        case QueryProjectIDRequest():
            return QueryProjectIDResponse(0)
        case QueryMemorySizeRequest():
            return QueryMemorySizeResponse(0, 0)
        case QueryRemainPowerRequest():
            return QueryRemainPowerResponse(0)
        case QueryActiveJoystickTableRequest():
            return QueryActiveJoystickTableResponse(0)
        case SetAngleUnitRequest():
            return SetAngleUnitResponse(packet.servo_id, packet.unit_type)
        case TransmissionModeSettingRequest():
            return TransmissionModeSettingResponse(1)
    return None


def _words(packet: Packet | None) -> str:
    if packet is None:
        return "an unreadable packet"
    described = packet_to_json(packet)
    return in_words(described["packet"], described["fields"])


def from_address(address: Address) -> Transport:
    """Make the transport for `replay://path/to/out.mcap?speed=2`, or for a recording in lines of JSON."""
    path = address.host + address.path
    if not path or address.port:
        raise address.refusal("must name a file: replay://path/to/out.mcap or replay:///path/to/out.mcap")
    try:
        with open_file(Path(path)) as file:
            is_mcap = file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        is_mcap = path.endswith(".mcap")  # opening the file raises the error
    if not is_mcap:
        return ReplayTransport.from_address(address)
    timing = address.flag("timing", default=True)
    speed = address.number("speed", 1.0, 0.0, 1000.0)
    address.refuse_unknown()
    return RecordedBoardTransport(path, speed=speed if timing else 0.0, url=address.url)
