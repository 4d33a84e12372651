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
    from servolink import sync as sync
    from servolink.client.alarms import Alarm as Alarm
    from servolink.client.alarms import RaisedAlarm as RaisedAlarm
    from servolink.client.board import Board as Board
    from servolink.client.button_events import ButtonEvent as ButtonEvent
    from servolink.client.button_events import ButtonEvents as ButtonEvents
    from servolink.client.connect import connect as connect
    from servolink.client.connect import reconnecting as reconnecting
    from servolink.client.playing import Playback as Playback
    from servolink.client.servo_readings import ServoReading as ServoReading
    from servolink.client.servo_readings import ServoReadings as ServoReadings
    from servolink.client.servo_state import Servo as Servo
    from servolink.client.servo_stream import ServoStream as ServoStream
    from servolink.connection.stats import Stats as Stats
    from servolink.discovery.search import discover as discover
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
    from servolink.errors import SeveralBoards as SeveralBoards
    from servolink.errors import TargetNotReached as TargetNotReached
    from servolink.errors import TransportError as TransportError
    from servolink.errors import TransportUnavailable as TransportUnavailable
    from servolink.errors import TwinError as TwinError
    from servolink.errors import WrongBoard as WrongBoard
    from servolink.motion.angles import Adc as Adc
    from servolink.motion.angles import Angle as Angle
    from servolink.motion.angles import Degrees as Degrees
    from servolink.profiles.profile import BoardProfile as BoardProfile
    from servolink.project.adjust import rename_record as rename_record
    from servolink.project.adjust import rename_servo as rename_servo
    from servolink.project.adjust import scale_project as scale_project
    from servolink.project.build import build_project as build_project
    from servolink.project.build import extend_project as extend_project
    from servolink.project.fix import fix_project as fix_project
    from servolink.project.merge import merge_projects as merge_projects
    from servolink.project.mirror import Mirror as Mirror
    from servolink.project.mirror import mirror_by_captions as mirror_by_captions
    from servolink.project.mirror import mirror_project as mirror_project
    from servolink.project.model import Project as Project
    from servolink.project.preflight import preflight as preflight
    from servolink.project.project_file import load_project as load_project
    from servolink.project.project_file import save_project as save_project
    from servolink.project.validate import Diagnostic as Diagnostic
    from servolink.project.validate import validate_project as validate_project
    from servolink.protocol.codec import Codec as Codec
    from servolink.protocol.parser import FrameParser as FrameParser
    from servolink.protocol.records import Action as Action
    from servolink.protocol.records import ActionEntry as ActionEntry
    from servolink.protocol.records import Button as Button
    from servolink.protocol.records import JoystickTable as JoystickTable
    from servolink.protocol.records import JoystickTableEntry as JoystickTableEntry
    from servolink.protocol.records import Macro as Macro
    from servolink.protocol.records import MacroCommand as MacroCommand
    from servolink.protocol.records import MacroCommandType as MacroCommandType
    from servolink.protocol.records import MacroEntry as MacroEntry
    from servolink.protocol.records import ServoParameter as ServoParameter
    from servolink.protocol.records import Step as Step
    from servolink.protocol.servos import ALL_SERVOS as ALL_SERVOS
    from servolink.recorder.reading import Recording as Recording
    from servolink.recorder.reading import open_recording as open_recording
    from servolink.recorder.recorder import Recorder as Recorder
    from servolink.recorder.recorder import record as record
    from servolink.recorder.writer import RecorderStatus as RecorderStatus
    from servolink.script import run as run
    from servolink.transports.device_info import DeviceInfo as DeviceInfo
    from servolink.transports.lifecycle import BaseTransport as BaseTransport
    from servolink.twin.reach import load_figure as load_figure
else:
    # Each module is imported at the first use of a name: the command line starts without most modules.
    _MODULES = {
        "Action": "servolink.protocol.records",
        "ActionEntry": "servolink.protocol.records",
        "Adc": "servolink.motion.angles",
        "ALL_SERVOS": "servolink.protocol.servos",
        "Alarm": "servolink.client.alarms",
        "AmbiguousName": "servolink.errors",
        "Angle": "servolink.motion.angles",
        "BaseTransport": "servolink.transports.lifecycle",
        "Board": "servolink.client.board",
        "BoardProfile": "servolink.profiles.profile",
        "LocalError": "servolink.errors",
        "Reason": "servolink.errors",
        "RemoteError": "servolink.errors",
        "RequestRefused": "servolink.errors",
        "build_project": "servolink.project.build",
        "Button": "servolink.protocol.records",
        "ButtonEvent": "servolink.client.button_events",
        "ButtonEvents": "servolink.client.button_events",
        "Codec": "servolink.protocol.codec",
        "connect": "servolink.client.connect",
        "ConnectionLost": "servolink.errors",
        "DecodeError": "servolink.errors",
        "Degrees": "servolink.motion.angles",
        "DeviceInfo": "servolink.transports.device_info",
        "Diagnostic": "servolink.project.validate",
        "discover": "servolink.discovery.search",
        "EncodeError": "servolink.errors",
        "extend_project": "servolink.project.build",
        "fix_project": "servolink.project.fix",
        "FrameParser": "servolink.protocol.parser",
        "InvalidAddress": "servolink.errors",
        "JoystickTable": "servolink.protocol.records",
        "JoystickTableEntry": "servolink.protocol.records",
        "load_figure": "servolink.twin.reach",
        "load_project": "servolink.project.project_file",
        "Macro": "servolink.protocol.records",
        "MacroCommand": "servolink.protocol.records",
        "MacroCommandType": "servolink.protocol.records",
        "MacroEntry": "servolink.protocol.records",
        "merge_projects": "servolink.project.merge",
        "Mirror": "servolink.project.mirror",
        "mirror_by_captions": "servolink.project.mirror",
        "mirror_project": "servolink.project.mirror",
        "MotionRefused": "servolink.errors",
        "NotFound": "servolink.errors",
        "open_recording": "servolink.recorder.reading",
        "OpenError": "servolink.errors",
        "OutcomeUnknown": "servolink.errors",
        "PacketError": "servolink.errors",
        "Playback": "servolink.client.playing",
        "preflight": "servolink.project.preflight",
        "ProfileError": "servolink.errors",
        "Project": "servolink.project.model",
        "ProjectError": "servolink.errors",
        "RaisedAlarm": "servolink.client.alarms",
        "reconnecting": "servolink.client.connect",
        "record": "servolink.recorder.recorder",
        "Recorder": "servolink.recorder.recorder",
        "RecorderStatus": "servolink.recorder.writer",
        "Recording": "servolink.recorder.reading",
        "RecordingError": "servolink.errors",
        "Rejected": "servolink.errors",
        "rename_record": "servolink.project.adjust",
        "rename_servo": "servolink.project.adjust",
        "RequestError": "servolink.errors",
        "RequestTimeout": "servolink.errors",
        "run": "servolink.script",
        "save_project": "servolink.project.project_file",
        "scale_project": "servolink.project.adjust",
        "Servo": "servolink.client.servo_state",
        "ServolinkError": "servolink.errors",
        "SeveralBoards": "servolink.errors",
        "ServoParameter": "servolink.protocol.records",
        "ServoReading": "servolink.client.servo_readings",
        "ServoReadings": "servolink.client.servo_readings",
        "ServoStream": "servolink.client.servo_stream",
        "Stats": "servolink.connection.stats",
        "Step": "servolink.protocol.records",
        "TargetNotReached": "servolink.errors",
        "TransportError": "servolink.errors",
        "TransportUnavailable": "servolink.errors",
        "TwinError": "servolink.errors",
        "validate_project": "servolink.project.validate",
        "WrongBoard": "servolink.errors",
    }
    __all__ = [*_MODULES]  # noqa: PLE0604 - the keys are strings

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            value: object = version("servolink")
        elif name in _MODULES or name in {"fleet", "sync"}:
            from importlib import import_module

            value = (
                getattr(import_module(_MODULES[name]), name) if name in _MODULES else import_module(f"servolink.{name}")
            )
        else:
            raise AttributeError(f"module 'servolink' has no attribute {name!r}")
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return [*__all__, "__version__", "fleet", "sync"]
