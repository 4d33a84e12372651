"""Twin: body of a robot with physics, made from the figure of a project: forecasts, reach, pictures.

figure = servolink.twin.load_figure("robot.servolink.json")
"""

from __future__ import annotations

from servolink.twin.board import read_board
from servolink.twin.body import Body, BodyPart, Solid
from servolink.twin.forecasts import Forecast, Verdict, forecast
from servolink.twin.jobs import FALLING, Frame, Judged, PhysicsProcess, Reached, frame_of
from servolink.twin.measuring import ServoMeasuring
from servolink.twin.motion_checks import check_move, check_record
from servolink.twin.placement import Placement, Vector, plus, times
from servolink.twin.reach import load_figure
from servolink.twin.simulation import Physics, checked_model, is_installed
from servolink.twin.softening import soften
from servolink.twin.trial import Fall, RunningTrial
from servolink.twin.urdf import ros_names, to_urdf
from servolink.twin.urdf_reading import read_urdf

__all__ = [
    # figures and bodies
    "Body",
    "BodyPart",
    "Placement",
    "Solid",
    "Vector",
    "checked_model",
    "load_figure",
    "plus",
    "read_urdf",
    "ros_names",
    "times",
    "to_urdf",
    # forecasts
    "check_move",
    "check_record",
    "Fall",
    "Forecast",
    "RunningTrial",
    "Verdict",
    "forecast",
    "read_board",
    "ServoMeasuring",
    "soften",
    # physics
    "PhysicsProcess",
    "FALLING",
    "Frame",
    "Judged",
    "Physics",
    "Reached",
    "frame_of",
    "is_installed",
]
