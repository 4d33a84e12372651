"""Board as a person sees it: connecting, servos, motion, records, events."""

from __future__ import annotations

from servolink.client.alarms import Alarm, AlarmWatch, Lasting, RaisedAlarm
from servolink.client.board import Board, servos_of, with_ticket
from servolink.client.board_identity import BoardIdentity
from servolink.client.button_events import ButtonEvent, ButtonEvents, ButtonSubscription
from servolink.client.captions import (
    ALL,
    Targets,
    button_id,
    find_servos,
    find_targets,
    record_id,
    servo_id,
    servo_ids,
    servo_or_caption,
    servo_targets,
)
from servolink.client.connecting import connect, reconnecting
from servolink.client.identity_guard import IdentityGuard
from servolink.client.playing import Playback
from servolink.client.projects import ignore_progress
from servolink.client.readers import SharedIterator
from servolink.client.servo_readings import ServoReading, ServoReadings, ServoWatch
from servolink.client.servo_state import Servo, Servos
from servolink.client.servo_stream import ServoStream, point_check
from servolink.client.session import Session
from servolink.client.stored_runs import check_can_wait, collect

__all__ = [
    # connecting
    "BoardIdentity",
    "IdentityGuard",
    "Session",
    "connect",
    "reconnecting",
    # board
    "Board",
    "servos_of",
    "with_ticket",
    # servos
    "Alarm",
    "AlarmWatch",
    "Lasting",
    "RaisedAlarm",
    "Servo",
    "ServoReading",
    "ServoReadings",
    "ServoStream",
    "ServoWatch",
    "Servos",
    "point_check",
    # events
    "ButtonEvent",
    "ButtonEvents",
    "ButtonSubscription",
    "SharedIterator",
    # motion
    "Playback",
    "check_can_wait",
    "collect",
    # captions
    "ALL",
    "Targets",
    "button_id",
    "find_servos",
    "find_targets",
    "record_id",
    "servo_id",
    "servo_ids",
    "servo_or_caption",
    "servo_targets",
    # projects
    "ignore_progress",
]
