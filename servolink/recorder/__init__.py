"""Recordings of what passed between programs and a board, in MCAP files (docs/design/recorder.md).

async with servolink.connect("virtual://") as board, servolink.recorder.record("arm.mcap", board):
    ...
for message in servolink.recorder.open_recording("arm.mcap").messages(servolink.recorder.ServosRead):
    print(message)
"""

from __future__ import annotations

from servolink.recorder.backlog import Backlog
from servolink.recorder.board_source import WireTap
from servolink.recorder.bug_report import BugReport, blank_recording
from servolink.recorder.channels import (
    CHANNELS,
    SCHEMA_ENCODING,
    SCHEMA_NAMES,
    TOPICS,
    CommandDone,
    Direction,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    Recorded,
    RecordedServo,
    ServosRead,
    Wire,
    decode,
    encode,
    schema,
)
from servolink.recorder.conversation import Asked, read_conversation
from servolink.recorder.hub_source import tapping
from servolink.recorder.late_recording import LateRecording
from servolink.recorder.mcap_check import has_sound_index
from servolink.recorder.mcap_reader import MAGIC
from servolink.recorder.new_file import check_free
from servolink.recorder.pcapng import Captured, save_pcapng, write_packets
from servolink.recorder.private_text import PrivateText
from servolink.recorder.reading import Entry, Recording, Selection, base_name, is_problem, open_recording
from servolink.recorder.readings import ReadingsFeed
from servolink.recorder.recorder import Recorder, Wanted, record, record_at
from servolink.recorder.recording_summary import Summary
from servolink.recorder.repairing import repair
from servolink.recorder.replaying import RecordedBoardTransport, from_address
from servolink.recorder.round_trips import Times
from servolink.recorder.story import Story, StoryRow, asked, duration
from servolink.recorder.tables import write_tables
from servolink.recorder.writer import RecorderStatus, Saved

__all__ = [
    # recording
    "Saved",
    "LateRecording",
    "Backlog",
    "ReadingsFeed",
    "Recorder",
    "RecorderStatus",
    "Wanted",
    "WireTap",
    "check_free",
    "record",
    "record_at",
    "tapping",
    # channels and messages
    "SCHEMA_ENCODING",
    "SCHEMA_NAMES",
    "encode",
    "schema",
    "CHANNELS",
    "CommandDone",
    "Direction",
    "Event",
    "MAGIC",
    "Message",
    "PacketSeen",
    "ProblemFound",
    "Recorded",
    "RecordedServo",
    "ServosRead",
    "TOPICS",
    "Wire",
    "decode",
    "has_sound_index",
    # reading
    "Asked",
    "Entry",
    "RecordedBoardTransport",
    "Recording",
    "Selection",
    "Story",
    "StoryRow",
    "Summary",
    "Times",
    "asked",
    "base_name",
    "duration",
    "from_address",
    "is_problem",
    "open_recording",
    "read_conversation",
    "repair",
    # other files
    "BugReport",
    "Captured",
    "PrivateText",
    "blank_recording",
    "save_pcapng",
    "write_packets",
    "write_tables",
]
