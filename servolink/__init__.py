"""servolink: drive a servo control board from asyncio, the shell, or with no board at all.

    async with servolink.connect("virtual://?servos=16") as board:
        print(await board.servos())
        await board.move({1: 120, 2: 60}, duration=0.5, wait=True)
"""

from servolink.client.angles import Adc, Angle, Degrees
from servolink.client.board import Board, connect
from servolink.client.events import ButtonEvent, ButtonEvents
from servolink.client.servos import Servo
from servolink.client.stats import Stats
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    NotFound,
    OpenError,
    OutcomeUnknown,
    PacketError,
    Rejected,
    RequestError,
    RequestTimeout,
    ServolinkError,
    TransportError,
    TransportUnavailable,
)
from servolink.protocol.codec import Codec
from servolink.protocol.editing import Action, ActionEntry, Macro, MacroCommand, MacroEntry, ServoParameter
from servolink.protocol.joystick import Button, JoystickTable, JoystickTableEntry
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import ALL_SERVOS, Step

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
]
