"""The `servolink` command: one file per group of commands."""
