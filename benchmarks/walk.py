"""Files of servolink that one movement, or one import, crosses: `python -m benchmarks.walk [LIST]`, in ten seconds.

A file counts once one of its functions is called. Left out are imports, lambdas and comprehensions, and the virtual
board with what serves it. LIST (any word) lists the calls of each file as well. The broker is mosquitto; without it the
way through a fleet is left out. `tests/test_house.py` holds the ceilings of these ways.
"""

from __future__ import annotations

import asyncio
import inspect
import json
import os
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from types import FrameType

import servolink
from benchmarks.fleet_processes import broker
from servolink.cli import run
from servolink.fleet import BoardPolicy, BrokerAccess, FleetFile, LocalBoard, LocalFleet, Topics, connect
from servolink.hub import serve_board
from servolink.support import socket_folder, socket_path

_PACKAGE = f"{Path(servolink.__file__).parent}{os.sep}"
_LEFT_OUT = ("virtual", "transports/listeners")
_MOVE = {"targets": {1: 30}, "duration": 0.1}


@contextmanager
def _walk(name: str) -> Iterator[None]:
    """Print how many files are crossed in this context."""
    calls: Counter[str] = Counter()

    def count(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_flags & inspect.CO_OPTIMIZED and code.co_name[0] != "<":
            place = code.co_filename.removeprefix(_PACKAGE)
            if place != code.co_filename and not place.startswith(_LEFT_OUT):
                calls[place] += 1

    sys.setprofile(count)
    try:
        yield
    finally:
        sys.setprofile(None)
        print(f"{name:12}{len(calls):4} files{calls.total():6} calls", file=sys.stderr)
        if sys.argv[1:]:
            print("".join(f"{number:8} {place}\n" for place, number in sorted(calls.items())), file=sys.stderr)


def _command(*arguments: str) -> None:
    if run(arguments):
        raise SystemExit(1)


async def _through_hub() -> None:
    async with serve_board("virtual://", name="walk"):
        with socket_folder() as folder:
            reader, writer = await asyncio.open_unix_connection(socket_path(folder, "walk"))

        async def ask(text: str, **message: object) -> None:
            writer.write(json.dumps(message).encode() + b"\n")
            while text not in (await reader.readline()).decode():
                pass

        await ask("session", servolink=1, wants="rpc", who="benchmarks.walk", role="move")
        await ask("result", jsonrpc="2.0", id=1, method="move", params=_MOVE)  # takes the lease
        await asyncio.sleep(0.5)  # on a busy machine, the end of the movement and timers came into the walk
        with _walk("hub move"):
            await ask("result", jsonrpc="2.0", id=2, method="move", params=_MOVE)
        await ask("result", jsonrpc="2.0", id=3, method="lease.give")
        if shutil.which("mosquitto"):
            with broker() as url:
                await _through_fleet(url)
        writer.close()


async def _through_fleet(url: str) -> None:
    ready = asyncio.Event()
    joined = LocalFleet(BrokerAccess.of(url), Topics(), FleetFile(BoardPolicy(allow="move")), hz=0)
    joining = asyncio.create_task(joined.join([LocalBoard("walk", "walk")], ready.set))
    await ready.wait()
    async with connect(BrokerAccess.of(url)) as fleet:
        await fleet.list()
        await fleet.call("walk", "move", _MOVE)
        with _walk("fleet move"):
            await fleet.call("walk", "move", _MOVE)
    joining.cancel()


def main() -> None:
    """Walk all ways."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
            os.environ[name] = folder
        asyncio.run(_through_hub())
        project = str(Path(folder) / "arm.servolink.json")
        with redirect_stdout(StringIO()):
            _command("project", "new", project, "--servos", "6")
            for way in (("move", "1=30"), ("apply", project, "--yes")):
                _command(*way, "--board", "virtual://")  # which imports its modules
                with _walk(f"CLI {way[0]}"):
                    _command(*way, "--board", "virtual://")


if __name__ == "__main__":
    main()
