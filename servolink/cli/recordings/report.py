"""`servolink report`: write a file for a bug report, without private content."""

from __future__ import annotations

import argparse
import asyncio
import platform
import re
from collections.abc import Iterator
from contextlib import AsyncExitStack
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from servolink.cli.arguments import not_empty, number
from servolink.cli.boards.doctor import examined
from servolink.cli.command import RECORDINGS, Command, flag, one_of, option
from servolink.cli.command_session import (
    KEEP_MODE,
    WOKEN,
    Interruption,
    connection_options,
    interruptible,
    mode_restored,
    refuse_without_answer,
)
from servolink.cli.screen.output import Table, print_error
from servolink.cli.screen.result import CommandResult, Ending, Part, Returned, print_for_people
from servolink.cli.screen.terminal import confirm
from servolink.cli.usage import refuse_input, usage_error
from servolink.client import Board, connect
from servolink.doctor import Report, SystemFacts, examine
from servolink.errors import RecordingError, ServolinkError
from servolink.project import ProjectFile
from servolink.recorder import BugReport, PrivateText, blank_recording, check_free, record
from servolink.support import ExitCode
from servolink.transports import DeviceInfo

_LIBRARIES = ("msgspec", "mcap", "pyserial", "pyserial-asyncio", "hidapi", "pyusb", "aiohttp")
_VERSION = re.compile(r"\d+(\.\d+)*")
_HZ = 20.0


class ReportWritten(CommandResult, frozen=True):
    """JSON of `report`: sizes of the file and of each content, in bytes."""

    file: str
    size_bytes: int
    contents: dict[str, int]


@Command(
    "report",
    RECORDINGS,
    help="write one file for a bug report, with nothing private in it",
    details="Captions, names, paths and serial numbers are blanked. What is in the file is "
    "shown before it is written, and nothing is sent to anybody.",
    examples=("report --yes --seconds 1", "report --recording out.mcap --yes -o bug.zip"),
    options=(
        option("-o --output", "OUT", "name of the new file (report.zip)", not_empty, default="report.zip"),
        one_of(
            option("--recording", "FILE", "the last 5 minutes of this recording", not_empty),
            option("--seconds", "N", "record for N seconds (10); 0: not", number(0, 300, "seconds"), default=10.0),
        ),
        KEEP_MODE,
        flag("--with-project", "add all content of the board, captions included"),
        flag("--force", "replace an existing file"),
        flag("--yes", "do not ask"),
    ),
)
@interruptible("no report was written")
async def run(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Collect the facts, show the content of the report, ask, and write the report."""
    refuse_without_answer(args)
    if args.recording:
        refuse_input(args, Path(args.recording), [Path(args.output)])
    check_free(Path(args.output), replace=args.force)  # before people wait for the recording
    with TemporaryDirectory(prefix="servolink-") as folder:
        report = await _collect(args, Path(folder))
    print_for_people(_contents(report, with_project=args.with_project))
    if not args.yes and not await confirm(f"write {args.output}?"):
        print_error("nothing was written")
        return ExitCode.FAILED
    report.write(Path(args.output), replace=args.force)
    contents = {name: len(content) for name, content in report.files.items()}
    return Returned(
        ReportWritten(args.output, len(report.packed), contents),
        f"wrote {args.output}; `servolink show {args.output}` shows all of it",
    )


async def _collect(args: argparse.Namespace, folder: Path) -> BugReport:
    """Return the report."""
    private = PrivateText()
    found = await examine(SystemFacts(), args.url, args.byte_order, args.timeout)
    _learn_devices(found, args.url, private)
    facts: dict[str, Any] = {
        "schema": 1,
        "created": datetime.now(UTC).strftime("%Y-%m-%d"),
        "versions": dict(_versions()),
        "system": _system(),
    }
    files: dict[str, bytes] = {}
    path = Path(args.recording) if args.recording else folder / BugReport.RECORDING
    trouble = ""
    if not found.is_absent and not args.recording:
        try:
            facts |= await _talk(args, found, path, files, private)
        except RecordingError:  # a missing extra, or a full disk: the remedy is the person's
            raise
        except ServolinkError as error:
            trouble = str(error)
    elif args.with_project:
        usage_error(args, "--with-project needs a board, and no --recording")
    if args.recording and _has_woken(found):
        print_error(WOKEN)
    if args.recording or path.exists():
        files[BugReport.RECORDING] = await asyncio.to_thread(blank_recording, path, private)
    facts["doctor"] = _examination(found, private)
    facts["trouble"] = private.blank(trouble)
    return BugReport(facts, files)


async def _talk(
    args: argparse.Namespace, examined: Report, path: Path, files: dict[str, bytes], private: PrivateText
) -> dict[str, Any]:
    """Record the board for a while; return counters and profile of the board."""
    async with AsyncExitStack() as stack:
        board = await stack.enter_async_context(
            connect(args.url or examined.urls[0], **connection_options(args), angle_unit=None)
        )
        await stack.enter_async_context(mode_restored(board, keeps_mode=args.keep_mode, woke=_has_woken(examined)))
        if args.seconds:
            print_error(f"recording for {args.seconds:g} s; do now what goes wrong")
            await stack.enter_async_context(record(path, board, hz=_HZ))
            await asyncio.sleep(args.seconds)
        if args.with_project:
            files[BugReport.PROJECT] = await _project(board)
        return _of_board(board, private)


async def _project(board: Board) -> bytes:
    return ProjectFile(await board.export_project()).text().encode()


def _has_woken(examined: Report) -> bool:
    """Return whether the examination has set mode 1 on a board in mode 0."""
    return examined.response is not None and examined.response.transmission_mode == 0


def _of_board(board: Board, private: PrivateText) -> dict[str, Any]:
    """Return counters and profile of the board, without identifying facts."""
    known: dict[str, Any] | None = None
    if board.profile is not None:
        if board.profile.name:
            private.hide(board.profile.name)
        profile = board.profile.profile
        known = {"settings": msgspec.to_builtins(profile.settings), "limits": msgspec.to_builtins(profile.limits)}
    scheme = board.url.partition("://")[0]
    return {"board": {"address": scheme}, "stats": board.stats.as_dict(), "profile": private.blank_all(known)}


def _learn_devices(examined: Report, given: str | None, private: PrivateText) -> None:
    """Hide the names of all devices that are here."""
    for url in (*examined.urls, given or ""):
        private.hide(url)
        private.hide(url.partition("://")[2].partition("?")[0])
    for device in examined.candidates:
        for text in (device.url, device.url.partition("://")[2], device.serial_number):
            private.hide(text)


def _examination(report: Report, private: PrivateText) -> dict[str, Any]:
    """Return the findings of the doctor, with private texts blanked."""
    found = msgspec.to_builtins(examined(report))
    devices = [{"address": device.url.partition("://")[0], "usb": _usb(device)} for device in report.candidates]
    findings = private.blank_all(found["findings"])
    return {"devices": devices, "response": found["response"], "line": found["line"], "findings": findings}


def _usb(device: DeviceInfo) -> str:
    """Return vendor and product id of a USB device, such as `0483:5740`."""
    identity = device.identity
    return "" if identity.vendor_id is None else f"{identity.vendor_id:04x}:{identity.product_id or 0:04x}"


def _versions() -> Iterator[tuple[str, str]]:
    yield "servolink", version("servolink")
    yield "python", platform.python_version()
    for library in _LIBRARIES:
        try:
            yield library, version(library)
        except PackageNotFoundError:
            continue


def _system() -> dict[str, str]:
    release = _VERSION.match(platform.release())
    return {
        "name": platform.system(),
        "release": release[0] if release else "",  # the rest may be the name of somebody's machine
        "machine": platform.machine(),
        "python": platform.python_implementation(),
    }


_MEANINGS = {
    BugReport.FACTS: "versions, doctor's findings, counters and settings",
    BugReport.RECORDING: "the recording, its captions and names blanked",
    BugReport.PROJECT: "ALL content of the board, captions included",
}


def _contents(report: BugReport, *, with_project: bool) -> Iterator[Part]:
    files = report.files
    yield Table(("file", "bytes", "content"), [(name, len(files[name]), _MEANINGS[name]) for name in files])
    yield from ("", *files[BugReport.FACTS].decode().splitlines(), "")
    left_out = "captions, serial numbers, paths, addresses, and the names of programs, boards, hosts and users"
    yield f"not in it: {left_out}" if not with_project else f"captions are only in {BugReport.PROJECT}"
    yield f"{len(report.packed)} bytes in all"
