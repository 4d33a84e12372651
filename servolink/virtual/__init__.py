"""Boards of software: a board without a clock, its servos and storage, and what reaches it."""

from __future__ import annotations

from servolink.virtual.board import HostSession, VirtualBoard
from servolink.virtual.board_script import Event, Keys, PowerCycle, Push, parse_script
from servolink.virtual.dry_run import DryMove, DryRun, Timeline
from servolink.virtual.handlers import HANDLERS, RequestContext, Response
from servolink.virtual.hardware import Hardware
from servolink.virtual.kind import BoardKind, Clear, KindOption, OnDuplicate, UnknownIds
from servolink.virtual.player import Player
from servolink.virtual.servers import serve
from servolink.virtual.simulated_servo import ADC, HIGHEST, LOWEST, SimulatedServo, to_adc, to_degrees
from servolink.virtual.state_file import StateFile, load_state, save_state
from servolink.virtual.storage import AnyType, Contents, Record, Storage
from servolink.virtual.transport import (
    BOARDS,
    AttachedSession,
    BoardDriver,
    BoardTransport,
    FaultyVirtualTransport,
    ServedBoard,
    StateSaver,
    VirtualTransport,
    from_address,
)

__all__ = [
    # board
    "ADC",
    "AnyType",
    "BoardKind",
    "Clear",
    "Contents",
    "HANDLERS",
    "HIGHEST",
    "Hardware",
    "HostSession",
    "KindOption",
    "LOWEST",
    "OnDuplicate",
    "Player",
    "Record",
    "RequestContext",
    "Response",
    "SimulatedServo",
    "Storage",
    "UnknownIds",
    "VirtualBoard",
    "to_adc",
    "to_degrees",
    # addresses and servers
    "AttachedSession",
    "BOARDS",
    "BoardDriver",
    "BoardTransport",
    "FaultyVirtualTransport",
    "ServedBoard",
    "StateFile",
    "StateSaver",
    "VirtualTransport",
    "from_address",
    "load_state",
    "save_state",
    "serve",
    # scripts and dry runs
    "DryMove",
    "DryRun",
    "Event",
    "Keys",
    "PowerCycle",
    "Push",
    "Timeline",
    "parse_script",
]
