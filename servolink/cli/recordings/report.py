"""`servolink report`: write a file for a bug report, without private content."""

from __future__ import annotations

import argparse
import asyncio
import platform
import re
from collections.abc import Iterator
from contextlib import AsyncExitStack
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import msgspec

from servolink.cli.arguments import not_empty, number
from servolink.cli.boards.doctor import described
from servolink.cli.command import RECORDINGS, Command, flag, one_of, option
from servolink.cli.command_session import (
    KEEP_MODE,
    WOKEN,
    Interruption,
    mode_restored,
    refuse_without_answer,
    run_interruptible,
)
from servolink.cli.screen.output import Table, print_error, print_json, print_table, print_text
from servolink.cli.screen.terminal import confirm
from servolink.cli.usage import refuse_input, usage_error
from servolink.doctor.examine import Report, examine
from servolink.doctor.system import SystemFacts
from servolink.errors import ServolinkError
from servolink.recorder.bug_report import FACTS, PROJECT, RECORDING, blank_recording, facts_text, pack, write_report
from servolink.recorder.new_file import check_free
from servolink.recorder.private_text import PrivateText
from servolink.script import FAILED, OK

if TYPE_CHECKING:
    from servolink.client.board import Board
    from servolink.transports.device_info import DeviceInfo

_LIBRARIES = ("msgspec", "mcap", "pyserial", "pyserial-asyncio", "hidapi", "pyusb", "aiohttp")
_VERSION = re.compile(r"\d+(\.\d+)*")
_HZ = 20.0


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
def run(args: argparse.Namespace) -> int:
    """Collect the facts, show the content of the report, ask, and write the report."""
    refuse_without_answer(args)
    if args.recording:
        refuse_input(args, Path(args.recording), [Path(args.output)])
    check_free(Path(args.output), replace=args.force)  # before people wait for the recording

    async def main(interruption: Interruption) -> int:
        with TemporaryDirectory(prefix="servolink-") as folder:
            files = await _collect(args, Path(folder))
        packed = pack(files)
        if not args.json:
            _show_contents(files, len(packed), with_project=args.with_project)
        if not args.yes and not await confirm(f"write {args.output}?"):
            print_error("nothing was written")
            return FAILED
        write_report(Path(args.output), packed, replace=args.force)
        if args.json:
            print_json(
                {"file": args.output, "size_bytes": len(packed), "contents": {n: len(c) for n, c in files.items()}}
            )
        else:
            print_text(f"wrote {args.output}; `servolink show {args.output}` shows all of it")
        return OK

    return run_interruptible(main, "no report was written")


async def _collect(args: argparse.Namespace, folder: Path) -> dict[str, bytes]:
    """Return the files of the report."""
    private = PrivateText()
    examined = await examine(SystemFacts(), args.url, args.byte_order, args.timeout)
    _learn_devices(examined, args.url, private)
    facts: dict[str, Any] = {
        "schema": 1,
        "created": datetime.now(UTC).strftime("%Y-%m-%d"),
        "versions": dict(_versions()),
        "system": _system(),
    }
    files: dict[str, bytes] = {}
    path = Path(args.recording) if args.recording else folder / RECORDING
    trouble = ""
    if not examined.is_absent and not args.recording:
        try:
            facts |= await _talk(args, examined, path, files, private)
        except ServolinkError as error:
            trouble = str(error)
    elif args.with_project:
        usage_error(args, "--with-project needs a board, and no --recording")
    if args.recording and _has_woken(examined):
        print_error(WOKEN)
    if args.recording or path.exists():
        files[RECORDING] = await asyncio.to_thread(blank_recording, path, private)
    facts["doctor"] = _examination(examined, private)
    facts["trouble"] = private.blank(trouble)
    return {FACTS: facts_text(facts), **files}


async def _talk(
    args: argparse.Namespace, examined: Report, path: Path, files: dict[str, bytes], private: PrivateText
) -> dict[str, Any]:
    """Record the board for a while; return counters and profile of the board."""
    from servolink.client.connect import connect
    from servolink.recorder.recorder import record

    async with AsyncExitStack() as stack:
        board = await stack.enter_async_context(
            connect(
                args.url or examined.urls[0],
                byte_order=args.byte_order,
                caption_encoding=args.caption_encoding,
                patience=args.timeout,
                transmission_mode="auto" if args.keep_mode else None,
                angle_unit=None,
            )
        )
        await stack.enter_async_context(mode_restored(board, keeps_mode=args.keep_mode, woke=_has_woken(examined)))
        if args.seconds:
            print_error(f"recording for {args.seconds:g} s; do now what goes wrong")
            await stack.enter_async_context(record(path, board, hz=_HZ))
            await asyncio.sleep(args.seconds)
        if args.with_project:
            files[PROJECT] = await _project(board)
        return _of_board(board, private)


async def _project(board: Board) -> bytes:
    from servolink.project.project_file import format_project

    return format_project(await board.export_project()).encode()


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


def _examination(examined: Report, private: PrivateText) -> dict[str, Any]:
    """Return the findings of the doctor, with private texts blanked."""
    found = described(examined)
    devices = [{"address": device.url.partition("://")[0], "usb": _usb(device)} for device in examined.candidates]
    findings = private.blank_all([asdict(finding) for finding in examined.findings])
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
    FACTS: "versions, doctor's findings, counters and settings",
    RECORDING: "the recording, its captions and names blanked",
    PROJECT: "ALL content of the board, captions included",
}


def _show_contents(files: dict[str, bytes], size: int, *, with_project: bool) -> None:
    print_table(Table(("file", "bytes", "content"), [(name, len(files[name]), _MEANINGS[name]) for name in files]))
    print_text("")
    for line in files[FACTS].decode().splitlines():
        print_text(line)
    print_text("")
    left_out = "captions, serial numbers, paths, addresses, and the names of programs, boards, hosts and users"
    print_text(f"not in it: {left_out}" if not with_project else f"captions are only in {PROJECT}")
    print_text(f"{size} bytes in all")
