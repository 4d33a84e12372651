"""Tools that every room needs: files, JSON text, tasks, pauses, numbers, and differences between systems."""

from __future__ import annotations

from servolink.support.files import (
    ALL,
    MIB,
    atomic_file,
    is_name,
    open_file,
    read_file,
    read_text,
    reason,
    write_atomically,
)
from servolink.support.json_text import MAX_SIZE, read_json, write_json
from servolink.support.lazy import lazy_names
from servolink.support.numeric import (
    SECONDS,
    as_number,
    check_seconds,
    checked_servo_id,
    is_integer,
    is_number,
)
from servolink.support.pauses import LONGEST_PAUSE, Pauses, Reconnecting
from servolink.support.platforms.drives import mounted_drives
from servolink.support.platforms.keyboard import begin_keys, read_line
from servolink.support.platforms.local_sockets import (
    connect_locally,
    is_same_user,
    listen_locally,
    socket_folder,
    socket_path,
)
from servolink.support.platforms.locks import LockedFile, claim_device, lock
from servolink.support.platforms.memory_pipes import listening_in_memory
from servolink.support.platforms.process import (
    Account,
    login_name,
    most_open_files,
)
from servolink.support.platforms.pseudo_terminals import PseudoTerminal
from servolink.support.platforms.signals import WAIT, Signals
from servolink.support.platforms.timers import SleepCounter, call_at, seconds_asleep, time_with_sleep
from servolink.support.platforms.user_folders import others_can_read, private_folder, user_folder
from servolink.support.script import ExitCode, run
from servolink.support.tasks import Tasks, computed

__all__ = [
    # files and JSON text
    "ALL",
    "MAX_SIZE",
    "MIB",
    "atomic_file",
    "is_name",
    "open_file",
    "read_file",
    "read_json",
    "read_text",
    "reason",
    "write_atomically",
    "write_json",
    # tasks and pauses
    "LONGEST_PAUSE",
    "Pauses",
    "Reconnecting",
    "Tasks",
    "computed",
    # numbers
    "SECONDS",
    "as_number",
    "check_seconds",
    "checked_servo_id",
    "is_integer",
    "is_number",
    # end of a program
    "ExitCode",
    "run",
    # doors with names that are imported on first use
    "lazy_names",
    # systems
    "connect_locally",
    "Account",
    "is_same_user",
    "listen_locally",
    "listening_in_memory",
    "PseudoTerminal",
    "SleepCounter",
    "Signals",
    "WAIT",
    "begin_keys",
    "call_at",
    "claim_device",
    "LockedFile",
    "lock",
    "login_name",
    "most_open_files",
    "mounted_drives",
    "others_can_read",
    "private_folder",
    "read_line",
    "seconds_asleep",
    "socket_folder",
    "socket_path",
    "time_with_sleep",
    "user_folder",
]
