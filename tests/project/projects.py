"""A small humanoid, for the tests of what is done with projects."""

from __future__ import annotations

from servolink.project.model import Project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step

RAISE = Action(1, "Raise left arm", (Step(1, 60, 50), Step(3, -30, 40), Step(5, 10, 20)))
NOD = Action(2, "Nod", (Step(5, 20, 30),))
WAVE = Macro(4, "Wave left", (MacroCommand(1, 0, 50, 2, 2000), MacroCommand(300, 1, total_interval=300)))
SHOW = Macro(5, "Show", (MacroCommand(4, 2, total_interval=2300), MacroCommand(2, total_interval=300)))
PAD = JoystickTable(7, "Pad", (Button(1, "wave", 4, 0, 5),))
HUMANOID = Project(
    project_id=77,
    servo_parameters=(
        ServoParameter(1, 3, "left shoulder"),
        ServoParameter(2, -2, "right shoulder"),
        ServoParameter(3, 0, "L elbow"),
        ServoParameter(4, 0, "R elbow"),
        ServoParameter(5, 0, "neck"),
    ),
    actions=(RAISE, NOD),
    macros=(WAVE, SHOW),
    joystick_tables=(PAD,),
    active_joystick_table=7,
)
