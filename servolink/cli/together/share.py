"""`servolink share`: one board for many programs, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import AsyncExitStack

from servolink.cli.arguments import board_name, listening, number
from servolink.cli.command import TOGETHER, Command, flag, group, one_of, option
from servolink.cli.screen.output import counted, print_error, print_json, print_text
from servolink.cli.session import Interruption, choose_board, run_interruptible
from servolink.cli.usage import usage_error
from servolink.script import OK

_MOST_SECONDS = 3600.0


@Command(
    "share",
    TOGETHER,
    help="share one board among programs that use it at the same time",
    examples=("share", "share --name rex --tcp 127.0.0.1:0", "share --name rex --watch-tcp 127.0.0.1:0"),
    options=(
        option("--name", "NAME", "programs call the board share://NAME (the name of the board)", board_name),
        option(
            "--tcp", "HOST:PORT", "also serve TCP, for programs in any language; port 0 takes a free one", listening
        ),
        option("--watch-tcp", "HOST:PORT", "the same for programs that may only read", listening),
        option("--pty", "LINK", "also serve a serial port, and link to it at LINK", nargs="?", const=""),
        option("--unit", "degree|adc", "angle unit of programs that set none (degree)", default="degree"),
        option("--door-byte-order", "little|big", "byte order of programs behind --tcp and --pty (that of the board)"),
        option(
            "--lease-seconds",
            "N",
            "how long after its last movement a program alone may move the servos (10)",
            number(0.0, _MOST_SECONDS, "seconds"),
            default=10.0,
        ),
        group(
            "to a hub that runs",
            one_of(
                flag("--status", "show its programs and counters"),
                option(
                    "--take", "NAME", "end the lease of the program that moves the servos, and keep it out", board_name
                ),
                option("--give", "NAME", "let it move them again", board_name),
            ),
        ),
    ),
)
def run(args: argparse.Namespace) -> int:
    """Share the board until Ctrl-C or SIGTERM, or talk to a hub that runs."""
    if args.status or args.take or args.give:
        from servolink.cli.together.share_status import talk_to_hub

        return talk_to_hub(args)

    args.url = choose_board(args)

    async def main(interruption: Interruption) -> int:
        return await _share(args, interruption)

    try:
        return run_interruptible(main, "nothing was sent to the board")
    except ValueError as error:
        usage_error(args, str(error))


async def _share(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until the task is cancelled."""
    from servolink.cli.screen.live import can_draw
    from servolink.cli.together.share_view import in_the_log, on_terminal
    from servolink.hub import serve_board

    served = serve_board(
        args.url,
        name=args.name,
        tcp=args.tcp,
        watch_tcp=args.watch_tcp,
        pty=args.pty,
        unit=args.unit,
        door_byte_order=args.door_byte_order,
        lease_seconds=args.lease_seconds,
        byte_order=args.byte_order,
        caption_encoding=args.caption_encoding,
        patience=args.timeout,
    )
    async with AsyncExitStack() as stack:
        hub, urls = await stack.enter_async_context(served)
        interruption.state, interruption.code = "the board was left as it is", OK
        watch_url = urls[1 + (args.tcp is not None)] if args.watch_tcp is not None else ""
        _print_doors(urls, watch_url, as_json=args.json)
        if not args.json and can_draw():
            show = await stack.enter_async_context(on_terminal(hub.status))
        else:
            show = stack.enter_context(in_the_log())
        stack.callback(hub.listen(lambda notice, session: show(notice, hub.name_of(session))))
        try:
            await asyncio.Event().wait()
        finally:
            if there := len(hub.programs):
                interruption.state = f"the board was left as it is, and {counted(there, 'program')} disconnected"
    return OK


def _print_doors(urls: list[str], watch_url: str, *, as_json: bool) -> None:
    """Print the addresses, and who can use those over TCP; programs at `watch_url` may only read."""
    from servolink.listeners.tcp import reached_by

    for url in urls:
        if as_json:
            print_json({"listening": url})
        else:
            print_text(f"listening {url}")
    for url in urls:
        if url.startswith("tcp://"):
            what = ", but only for reading" if url == watch_url else ""
            print_error(f"servolink: {url} is open to {reached_by(url)}{what}")
