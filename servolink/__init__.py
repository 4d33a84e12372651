"""servolink: drive a servo control board from asyncio, the shell, or with no board at all.

async with servolink.connect("virtual://?servos=16") as board:
    print(await board.servos())
    await board.move({1: 120, 2: 60}, duration=0.5, wait=True)
"""

from __future__ import annotations

import sys

if sys.version_info < (3, 11):  # noqa: UP036 - pip refuses older ones, but a copied folder of source files does not
    raise ImportError(
        "servolink needs Python 3.11 or newer, and this is Python " + ".".join(map(str, sys.version_info[:3])),
        name="servolink",  # so that `python -m servolink` prints one line
    )

TYPE_CHECKING = False  # the constant of `typing` without its import: before `__main__` runs, nothing catches Ctrl-C

if TYPE_CHECKING:
    __all__: list[str]
    __version__: str
    from servolink import fleet as fleet
    from servolink import hub as hub
    from servolink import recorder as recorder
    from servolink import sync as sync
    from servolink import twin as twin
    from servolink.boards import BoardProfile as BoardProfile
    from servolink.boards import discover as discover
    from servolink.client import Alarm as Alarm
    from servolink.client import Board as Board
    from servolink.client import ButtonEvent as ButtonEvent
    from servolink.client import ButtonEvents as ButtonEvents
    from servolink.client import Playback as Playback
    from servolink.client import RaisedAlarm as RaisedAlarm
    from servolink.client import Servo as Servo
    from servolink.client import ServoReading as ServoReading
    from servolink.client import ServoReadings as ServoReadings
    from servolink.client import ServoStream as ServoStream
    from servolink.client import connect as connect
    from servolink.client import reconnecting as reconnecting
    from servolink.connection import Stats as Stats
    from servolink.errors import AmbiguousName as AmbiguousName
    from servolink.errors import ConnectionLost as ConnectionLost
    from servolink.errors import DecodeError as DecodeError
    from servolink.errors import EncodeError as EncodeError
    from servolink.errors import InvalidAddress as InvalidAddress
    from servolink.errors import LocalError as LocalError
    from servolink.errors import MotionRefused as MotionRefused
    from servolink.errors import NotFound as NotFound
    from servolink.errors import OpenError as OpenError
    from servolink.errors import OutcomeUnknown as OutcomeUnknown
    from servolink.errors import PacketError as PacketError
    from servolink.errors import ProfileError as ProfileError
    from servolink.errors import ProjectError as ProjectError
    from servolink.errors import Reason as Reason
    from servolink.errors import RecordingError as RecordingError
    from servolink.errors import Rejected as Rejected
    from servolink.errors import RemoteError as RemoteError
    from servolink.errors import RequestError as RequestError
    from servolink.errors import RequestRefused as RequestRefused
    from servolink.errors import RequestTimeout as RequestTimeout
    from servolink.errors import ServolinkError as ServolinkError
    from servolink.errors import ServoStalled as ServoStalled
    from servolink.errors import SeveralBoards as SeveralBoards
    from servolink.errors import TargetNotReached as TargetNotReached
    from servolink.errors import TransportError as TransportError
    from servolink.errors import TransportUnavailable as TransportUnavailable
    from servolink.errors import TwinError as TwinError
    from servolink.errors import WrongBoard as WrongBoard
    from servolink.motion import Adc as Adc
    from servolink.motion import Angle as Angle
    from servolink.motion import Degrees as Degrees
    from servolink.project import Diagnostic as Diagnostic
    from servolink.project import Mirror as Mirror
    from servolink.project import Project as Project
    from servolink.project import build_project as build_project
    from servolink.project import extend_project as extend_project
    from servolink.project import fix_project as fix_project
    from servolink.project import load_project as load_project
    from servolink.project import merge_projects as merge_projects
    from servolink.project import mirror_by_captions as mirror_by_captions
    from servolink.project import mirror_project as mirror_project
    from servolink.project import preflight as preflight
    from servolink.project import rename_record as rename_record
    from servolink.project import rename_servo as rename_servo
    from servolink.project import save_project as save_project
    from servolink.project import scale_project as scale_project
    from servolink.project import validate_project as validate_project
    from servolink.protocol import ALL_SERVOS as ALL_SERVOS
    from servolink.protocol import Action as Action
    from servolink.protocol import ActionEntry as ActionEntry
    from servolink.protocol import Button as Button
    from servolink.protocol import Codec as Codec
    from servolink.protocol import FrameParser as FrameParser
    from servolink.protocol import JoystickTable as JoystickTable
    from servolink.protocol import JoystickTableEntry as JoystickTableEntry
    from servolink.protocol import Macro as Macro
    from servolink.protocol import MacroCommand as MacroCommand
    from servolink.protocol import MacroCommandType as MacroCommandType
    from servolink.protocol import MacroEntry as MacroEntry
    from servolink.protocol import ServoParameter as ServoParameter
    from servolink.protocol import Step as Step
    from servolink.support import run as run
    from servolink.transports import BaseTransport as BaseTransport
    from servolink.transports import DeviceInfo as DeviceInfo
else:
    # Each room is imported at the first use of one of its names: the command line starts without most rooms.
    _ROOMS = {
        "client": (
            "Alarm Board ButtonEvent ButtonEvents Playback RaisedAlarm Servo ServoReading ServoReadings ServoStream "
            "connect reconnecting"
        ),
        "boards": "BoardProfile discover",
        "motion": "Adc Angle Degrees",
        "protocol": (
            "ALL_SERVOS Action ActionEntry Button Codec FrameParser JoystickTable JoystickTableEntry Macro "
            "MacroCommand MacroCommandType MacroEntry ServoParameter Step"
        ),
        "project": (
            "Diagnostic Mirror Project build_project extend_project fix_project load_project merge_projects "
            "mirror_by_captions mirror_project preflight rename_record rename_servo save_project scale_project "
            "validate_project"
        ),
        "transports": "BaseTransport DeviceInfo",
        "connection": "Stats",
        "support": "run",
        "errors": (
            "AmbiguousName ConnectionLost DecodeError EncodeError InvalidAddress LocalError MotionRefused NotFound "
            "OpenError OutcomeUnknown PacketError ProfileError ProjectError Reason RecordingError Rejected "
            "RemoteError RequestError RequestRefused RequestTimeout ServoStalled ServolinkError SeveralBoards "
            "TargetNotReached TransportError TransportUnavailable TwinError WrongBoard"
        ),
    }
    _ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names.split()}
    _PUBLIC_ROOMS = ("fleet", "hub", "recorder", "sync", "twin")
    __all__ = [*_ROOM_OF]  # noqa: PLE0604 - the keys are strings

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            value: object = version("servolink")
        elif name in _ROOM_OF or name in _PUBLIC_ROOMS:
            from importlib import import_module

            room = import_module(f"servolink.{_ROOM_OF.get(name, name)}")
            value = getattr(room, name) if name in _ROOM_OF else room
        else:
            raise AttributeError(f"module 'servolink' has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return [*__all__, "__version__", *_PUBLIC_ROOMS]
