"""Boards and devices of software that try servolink, served to other programs by `python -m tests.lab.serve`."""
