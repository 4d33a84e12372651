"""The public names, which `servolink` itself offers."""

from servolink.client.angles import Adc, Angle, Degrees
from servolink.client.board import Board
from servolink.client.connect import connect, reconnecting
from servolink.client.events import ButtonEvent, ButtonEvents
from servolink.client.servos import Servo
from servolink.client.stats import Stats
from servolink.discovery.search import discover
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    NotFound,
    OpenError,
    OutcomeUnknown,
    PacketError,
    ProjectError,
    Rejected,
    RequestError,
    RequestTimeout,
    ServolinkError,
    TransportError,
    TransportUnavailable,
)
from servolink.project.files.file import load_project, save_project
from servolink.project.model import Project
from servolink.protocol.codec import Codec
from servolink.protocol.editing import Action, ActionEntry, Macro, MacroCommand, MacroEntry, ServoParameter
from servolink.protocol.joystick import Button, JoystickTable, JoystickTableEntry
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import ALL_SERVOS, Step
from servolink.transports.candidate import Candidate

__all__ = [
    "ALL_SERVOS",
    "Action",
    "ActionEntry",
    "Adc",
    "Angle",
    "Board",
    "Button",
    "ButtonEvent",
    "ButtonEvents",
    "Candidate",
    "Codec",
    "ConnectionLost",
    "DecodeError",
    "Degrees",
    "EncodeError",
    "FrameParser",
    "JoystickTable",
    "JoystickTableEntry",
    "Macro",
    "MacroCommand",
    "MacroEntry",
    "NotFound",
    "OpenError",
    "OutcomeUnknown",
    "PacketError",
    "Project",
    "ProjectError",
    "Rejected",
    "RequestError",
    "RequestTimeout",
    "Servo",
    "ServoParameter",
    "ServolinkError",
    "Stats",
    "Step",
    "TransportError",
    "TransportUnavailable",
    "connect",
    "discover",
    "load_project",
    "reconnecting",
    "save_project",
]
