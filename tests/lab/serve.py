"""Serve a board of software to other programs until Ctrl-C: `python -m tests.lab.serve late --tcp 127.0.0.1:0`.

A kind of odd board is served with the settings of its kind; `virtual://?servos=3` is a virtual board with its options.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, suppress
from typing import TypeVar

from servolink.errors import TransportError
from servolink.transports import Faults, NetworkPlace, create
from servolink.virtual import ServedBoard, VirtualTransport, serve
from tests.lab.odd.kinds import KINDS
from tests.lab.usb_board import serve_usb_device

T = TypeVar("T")


def _board(text: str) -> ServedBoard:
    """Return a new odd board of a kind, or the virtual board of an address."""
    if text in KINDS:
        return KINDS[text]()
    if not text.startswith("virtual://"):
        raise argparse.ArgumentTypeError(f"must be virtual:// or one of {', '.join(KINDS)}, not {text!r}")
    transport = _read(create, text)
    if not isinstance(transport, VirtualTransport):
        raise argparse.ArgumentTypeError("give the faults of the line with --faults")
    return transport.board


def _faults(text: str) -> Faults:
    return _read(Faults.parse, text)


def _read(make: Callable[[str], T], text: str) -> T:
    try:
        return make(text)
    except TransportError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


async def _serve(args: argparse.Namespace) -> None:
    async with AsyncExitStack() as stack:
        serving = serve(args.board, pty=args.pty, tcp=args.tcp, faults=args.faults, seed=args.seed)
        urls = await stack.enter_async_context(serving)
        if args.usbip:
            export = serve_usb_device(args.board, f"virtual-{args.seed}", *NetworkPlace.parse(args.usbip))
            place, _ = await stack.enter_async_context(export)
            urls.append(f"usbip://{place}")
        for url in urls:
            print(f"listening {url}", flush=True)
        await asyncio.Event().wait()


def main(arguments: Sequence[str]) -> None:
    """Serve until Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.serve", description=__doc__)
    parser.add_argument("board", type=_board, metavar="KIND", help="kind of odd board, or virtual://?OPTION=VALUE")
    parser.add_argument("--pty", action="store_true", help="serve a pseudo-terminal")
    parser.add_argument("--tcp", metavar="HOST:PORT", help="serve TCP; port 0 takes a free one")
    parser.add_argument("--usbip", metavar="HOST:PORT", help="export a USB device over USB/IP; its usual port is 3240")
    parser.add_argument("--faults", type=_faults, metavar="NAME=VALUE,...", help="a bad line, but for --usbip")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="seed of the faults; the USB device is virtual-N"
    )
    args = parser.parse_args(arguments)
    if not (args.pty or args.tcp or args.usbip):
        parser.error("where? give --pty, --tcp or --usbip")
    with suppress(KeyboardInterrupt):
        asyncio.run(_serve(args))


if __name__ == "__main__":
    main(sys.argv[1:])
