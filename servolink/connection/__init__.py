"""Conversation with one board: opening, matching of responses, deadlines, repeats and stops."""

from __future__ import annotations

from servolink.connection.call import Content, Lane, Settled, Slot
from servolink.connection.connection import Connection
from servolink.connection.deadlines import NewsTimer
from servolink.connection.dispatcher import NestedFrameFilter, ResponseDispatcher
from servolink.connection.evidence import HandshakeFailed, text_between
from servolink.connection.explain import lost, outcome_unknown, timed_out
from servolink.connection.fences import FENCES, SERVO_LIST
from servolink.connection.gates import Gates, UnitsChanged
from servolink.connection.handshake import Handshake
from servolink.connection.line_marks import LONG_PAUSE, LineBytes, Mark
from servolink.connection.options import (
    ConnectionOptions,
    TransmissionMode,
    options_in,
)
from servolink.connection.packet_connection import BoardSharing, PacketConnection, SendPoints
from servolink.connection.repeating_slots import RepeatingSlots
from servolink.connection.repeats import SURE_COPIES
from servolink.connection.sender import RequestSender
from servolink.connection.slots import Obstacle, Slots
from servolink.connection.stats import Stats
from servolink.connection.taps import Tap, Taps
from servolink.connection.times import HUB_MARGIN, PATIENCE, SLOW_PATIENCE
from servolink.connection.watchdog import ResponseWatchdog

__all__ = [
    # connections
    "BoardSharing",
    "Connection",
    "ConnectionOptions",
    "Gates",
    "HUB_MARGIN",
    "PATIENCE",
    "PacketConnection",
    "SLOW_PATIENCE",
    "SendPoints",
    "TransmissionMode",
    "UnitsChanged",
    "options_in",
    # statistics and taps
    "Stats",
    "Tap",
    "Taps",
    "SURE_COPIES",
    # texts of errors, and what bytes show
    "HandshakeFailed",
    "LONG_PAUSE",
    "LineBytes",
    "Mark",
    "lost",
    "outcome_unknown",
    "text_between",
    "timed_out",
    # matching
    "Content",
    "FENCES",
    "Handshake",
    "Lane",
    "NestedFrameFilter",
    "NewsTimer",
    "Obstacle",
    "RepeatingSlots",
    "RequestSender",
    "ResponseDispatcher",
    "ResponseWatchdog",
    "SERVO_LIST",
    "Settled",
    "Slot",
    "Slots",
]
