"""`servolink wireshark`: a dissector, printed or installed."""

from __future__ import annotations

import argparse

from msgspec import UNSET, UnsetType

from servolink.cli.command import DEVELOPERS, Command, flag
from servolink.cli.screen.result import CommandResult, Remark, Returned, Verbatim
from servolink.cli.usage import usage_error
from servolink.doctor import dissector, install


class Dissector(CommandResult, frozen=True, kw_only=True):
    """JSON of `wireshark`: the text of the dissector, or with --install its file."""

    dissector: str | UnsetType = UNSET
    installed: str | UnsetType = UNSET


@Command(
    "wireshark",
    DEVELOPERS,
    help="print or install a dissector with which Wireshark reads packets",
    details="The dissector is Lua that reads every packet, over TCP and in captures of a line.\n\n"
    "--byte-order and --caption-encoding set what its preferences are at first; without --byte-order it finds the "
    "order of each frame.",
    examples=("wireshark --install", "wireshark --byte-order big --caption-encoding big5"),
    options=(flag("--install", "write it into the folder of personal plugins instead"),),
    takes_board=False,
)
def run(args: argparse.Namespace) -> Returned:
    """Print or install the dissector."""
    try:
        text = dissector(args.byte_order, args.caption_encoding or "utf-8")
    except ValueError as error:
        usage_error(args, f"argument --caption-encoding: {error}")
    if not args.install:
        return Returned(Dissector(dissector=text), Verbatim(text))
    path = str(install(text))
    hint = Remark("restart Wireshark, or press Ctrl+Shift+L in it")
    return Returned(Dissector(installed=path), [f"installed {path}", hint])
