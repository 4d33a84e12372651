"""`servolink wireshark`: a dissector, printed or installed."""

from __future__ import annotations

import argparse

from servolink.cli.command import DEVELOPERS, Command, flag
from servolink.cli.screen.output import print_error, print_json, print_text
from servolink.cli.usage import usage_error
from servolink.script import OK


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
def run(args: argparse.Namespace) -> int:
    """Print or install the dissector."""
    from servolink.wireshark.dissector import dissector, install

    try:
        text = dissector(args.byte_order, args.caption_encoding or "utf-8")
    except ValueError as error:
        usage_error(args, f"argument --caption-encoding: {error}")
    if not args.install:
        if args.json:
            print_json({"dissector": text})
        else:
            print(text, end="", flush=True)
        return OK
    path = install(text)
    if args.json:
        print_json({"installed": str(path)})
    else:
        print_text(f"installed {path}")
        print_error("servolink: restart Wireshark, or press Ctrl+Shift+L in it")
    return OK
