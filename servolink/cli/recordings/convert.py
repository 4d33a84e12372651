"""`servolink convert`: a recording in the form of other tools."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from servolink.cli.arguments import file_path, not_empty
from servolink.cli.command import RECORDINGS, Command, flag, one_of, option
from servolink.cli.recordings.show import SELECTION, selection
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Remark, Returned
from servolink.cli.usage import refuse_input, usage_error
from servolink.project import ProjectFile
from servolink.recorder import CHANNELS, Recorded, Recording, Selection, Wire, save_pcapng, write_tables


class Converted(CommandResult, frozen=True):
    """JSON of `convert`: the rows, packets or messages in each file."""

    files: dict[str, int]
    remarks: Sequence[str]


@Command(
    "convert",
    RECORDINGS,
    help="write a recording in the form of other tools",
    examples=(
        "convert out.mcap --csv",
        "convert out.mcap --csv --channel servos -o servos.csv",
        "convert out.mcap --pcap",
        "convert out.mcap --foxglove --project robot.servolink.json",
    ),
    options=(
        option("file", "FILE", "a recording", not_empty),
        one_of(
            flag("--csv", "write a table for each channel, for spreadsheets"),
            flag("--pcap", "write a capture of the line, for Wireshark"),
            flag("--foxglove", "write a recording with joints, transforms, scene and log, for Foxglove"),
            required=True,
        ),
        option(
            "-o --output",
            "OUT",
            "name of the new file, to which several tables add the names of their channels (FILE's, beside it)",
            not_empty,
        ),
        option("--project", "FILE", "with --foxglove: a project file with the figure of the robot", file_path),
        flag("--force", "replace an existing file"),
        *SELECTION,
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> Returned:
    """Write the recording in another form."""
    if args.project is not None and not args.foxglove:
        usage_error(args, "--project gives the figure for --foxglove; leave it out for other forms")
    recording = Recording(args.file)
    write = _write_capture if args.pcap else _write_channels if args.foxglove else _write_tables
    written = write(args, recording)
    remarks = recording.remarks
    unit = "packet" if args.pcap else "message" if args.foxglove else "row"
    lines = [f"{path}  {counted(count, unit)}" for path, count in written.items()]
    return Returned(
        Converted({str(path): count for path, count in written.items()}, remarks),
        [
            *(lines or ["nothing was written: the recording holds nothing of this kind"]),
            *(Remark(f"{recording.path}: {remark}") for remark in remarks),
        ],
    )


def _write_channels(args: argparse.Namespace, recording: Recording) -> dict[Path, int]:
    from servolink.gateways.foxglove import convert

    figure = None if args.project is None else ProjectFile.read(args.project).figure
    out = Path(args.output) if args.output else _beside(recording.path, ".foxglove.mcap")
    refuse_input(args, recording.path, [out])
    return {out: convert(recording.entries(selection(args)), figure, out, replace=args.force)}


def _write_tables(args: argparse.Namespace, recording: Recording) -> dict[Path, int]:
    wanted = selection(args)
    out = Path(args.output) if args.output else _beside(recording.path, ".csv")

    def path_of(channel: str) -> Path:
        return out if args.output and len(wanted.topics) == 1 else out.with_suffix(f".{channel}{out.suffix}")

    refuse_input(args, recording.path, (path_of(topic.removeprefix("/")) for topic in wanted.topics or CHANNELS))
    return write_tables(recording.entries(wanted), path_of, replace=args.force)


def _write_capture(args: argparse.Namespace, recording: Recording) -> dict[Path, int]:
    wanted = selection(args)
    if wanted != Selection(wanted.since, wanted.until):
        usage_error(args, "--pcap writes all bytes of the line: only --from and --to select a part")
    out = Path(args.output) if args.output else _beside(recording.path, ".pcapng")
    refuse_input(args, recording.path, [out])
    wire = ((entry.time, entry.message) for entry in recording.messages(Wire, since=wanted.since, until=wanted.until))
    recorded = recording.about or Recorded("", "", recording.path.name, "board")
    return {out: save_pcapng(out, wire, recorded, replace=args.force)}


def _beside(path: Path, suffix: str) -> Path:
    """Return the name for another form of a recording: only `.mcap` is dropped, as names may have dots."""
    return path.with_name((path.stem if path.suffix.lower() == ".mcap" else path.name) + suffix)
