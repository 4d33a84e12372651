"""Hours of a whole installation on a board that loses responses and is unplugged every minute.

A hub, a studio with an open page, a recorder and the bridge of a fleet run as programs of their own. None may grow or
keep a descriptor, no answer may be wrong, and each loss must be seen at once.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import tempfile
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path
from random import Random
from statistics import mean
from typing import NamedTuple

import aiohttp

import servolink
from benchmarks.fleet_processes import MOSQUITTO, broker
from benchmarks.measuring import Result, table
from benchmarks.studio_place import started
from servolink.errors import ServolinkError

_LOST = 0.01  # of the pieces in each direction: a request or a response each
_MINUTE = 60.0
_GONE = 2.0  # seconds for which the board is unplugged
_BACK = 5.0  # seconds in which all connections are open again
_LOOK = 5.0  # seconds between two looks at the programs
_WARM = 1 / 3  # share of the time in which memory may still grow
_MOST_GROWTH = 0.02
_MOST_AT_FIRST = 0.1  # in the first minutes, while the hub still fills what it keeps of its latest past
_SEEN_WITHIN = 0.1  # seconds


class Cable:
    """The line between the hub and the board: a relay that loses pieces, and can be pulled."""

    def __init__(self, port: int) -> None:
        """Lead to the board that serves at `port`."""
        self.pulled_at = 0.0
        self._board = port
        self._random = Random(1)
        self._server: asyncio.Server | None = None
        self._port = 0
        self._writers: set[asyncio.StreamWriter] = set()

    async def plug(self) -> str:
        """Let connections through; return the address."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self._port)
        self._port = self._server.sockets[0].getsockname()[1]
        return f"tcp://127.0.0.1:{self._port}"

    def pull(self) -> None:
        """End all connections, and let none through."""
        self.pulled_at = asyncio.get_running_loop().time()
        if self._server is not None:
            self._server.close()
        for writer in self._writers:
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        board_reader, board_writer = await asyncio.open_connection("127.0.0.1", self._board)
        both = {writer, board_writer}
        self._writers |= both
        with suppress(asyncio.CancelledError):  # the end of this program
            await asyncio.gather(self._carry(reader, board_writer), self._carry(board_reader, writer))
        self._writers -= both

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            while piece := await reader.read(65536):
                if self._random.random() >= _LOST:
                    writer.write(piece)
        writer.transport.abort()


class Look(NamedTuple):
    """What a program holds at one time."""

    memory: int
    """Bytes that are resident."""
    descriptors: int


def look(process: int) -> Look:
    """Look at a program; on Linux only."""
    folder = Path("/proc", str(process))
    found = re.search(r"VmRSS:\s+(\d+)", (folder / "status").read_text(encoding="utf-8"))
    return Look(int(found[1]) * 1024 if found else 0, len(list((folder / "fd").iterdir())))


class Witness:
    """What was asked and answered, and when a loss was seen by whom."""

    def __init__(self, cable: Cable) -> None:
        """Compare with when `cable` was pulled."""
        self.counts: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.seen: dict[str, list[float]] = {}
        """Seconds from each loss until it was seen, by program."""
        self._cable = cable

    def saw_loss(self, who: str) -> None:
        """Note that a program has just seen the loss of the board."""
        self.seen.setdefault(who, []).append(asyncio.get_running_loop().time() - self._cable.pulled_at)

    async def ask(self, address: str) -> None:
        """Ask the board for what is known, until cancelled."""
        async with servolink.connect(address, reconnect=True) as board, asyncio.TaskGroup() as group:
            group.create_task(self._follow(board))
            expected = [(action.action_id, action.action_caption) for action in await board.actions()]
            while True:
                try:
                    actions = [(action.action_id, action.action_caption) for action in await board.actions()]
                    servos = sorted([servo.servo_id for servo in await board.servos()])
                except ServolinkError:
                    self.counts["failed"] += 1
                    await asyncio.sleep(0.1)
                    continue
                self.counts["answered"] += 2
                if actions != expected or servos != list(range(1, 17)):
                    self.wrong.append(f"{actions} and {servos} were read")
                await asyncio.sleep(0.05)

    async def _follow(self, board: servolink.Board) -> None:
        async for state in board.states():
            if state == "lost":
                self.saw_loss("program")

    async def open_page(self, address: str) -> None:
        """Be a page of the studio, until cancelled."""
        origin, _, token = address.partition("/#token=")
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{origin}/ws", origin=origin) as messages:
            await messages.send_json({"token": token})
            await messages.send_json({"jsonrpc": "2.0", "id": 1, "method": "servos.watch", "params": {"hz": 50}})
            async for message in messages:
                self.counts["messages to the page"] += 1
                told = json.loads(message.data)
                if told.get("method") == "servos":
                    ack = {"number": told["params"]["number"]}
                    await messages.send_json({"jsonrpc": "2.0", "method": "servos.ack", "params": ack})
                elif told.get("method") == "connection" and told["params"]["state"] == "lost":
                    self.saw_loss("page")


@contextmanager
def _own_folders() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="servolink-hours-") as folder:
        before = dict(os.environ)
        for name in ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
            os.environ[name] = folder
        try:
            yield Path(folder)
        finally:
            os.environ.clear()
            os.environ.update(before)


async def _program(stack: ExitStack, *arguments: str, pattern: str = "") -> tuple[int, str]:
    """Start a command, and return its process id and the first text it prints that fits `pattern`."""
    program = stack.enter_context(started("servolink", *arguments))
    assert program.stdout is not None
    while pattern:
        line = await asyncio.to_thread(program.stdout.readline)
        if found := re.search(pattern, line):
            return program.pid, found[0]
        if not line:
            raise RuntimeError(f"servolink {' '.join(arguments)} ended")
    return program.pid, ""


@asynccontextmanager
async def _installed(folder: Path) -> AsyncIterator[tuple[Cable, dict[str, int], str, str]]:
    """Run all programs; yield the cable, their process ids, and the addresses of the hub and of the page."""
    with ExitStack() as stack:
        mqtt = stack.enter_context(broker()) if MOSQUITTO else ""
        _, board = await _program(stack, "virtual", "--tcp", "127.0.0.1:0", pattern=r"tcp://\S+")
        cable = Cable(int(board.rpartition(":")[2]))
        address = await cable.plug()
        demo = Path(servolink.__file__).parent / "studio/demo.servolink.json"
        await asyncio.to_thread(_apply, board, demo)
        found = {}
        found["hub"], hub = await _program(
            stack, "--board", address, "share", "--name", "hours", pattern=r"share://\S+"
        )
        found["studio"], page = await _program(stack, "--board", hub, "studio", "--no-browser", pattern=r"http://\S+")
        found["recorder"], _ = await _program(stack, "--board", hub, "record", str(folder / "hours.mcap"))
        if mqtt:
            found["bridge"], _ = await _program(stack, "fleet", "join", mqtt, hub)
        try:
            yield cable, found, hub, page
        finally:
            cable.pull()


def _apply(board: str, demo: Path) -> None:
    with servolink.sync.connect(board) as opened:
        opened.apply_project(servolink.load_project(demo))


async def _live(hours: float) -> tuple[Witness, dict[str, list[Look]]]:
    looks: dict[str, list[Look]] = {}
    loop = asyncio.get_running_loop()
    with _own_folders() as folder:
        async with _installed(folder) as (cable, programs, hub, page), AsyncExitStack() as stack:
            witness = Witness(cable)
            tasks = [asyncio.create_task(witness.ask(hub)), asyncio.create_task(witness.open_page(page))]
            stack.callback(lambda: [task.cancel() for task in tasks])
            end, pull_at = loop.time() + 3600 * hours, loop.time() + _MINUTE / 2
            while loop.time() < end:
                await asyncio.sleep(_LOOK)
                for task in tasks:
                    if task.done():
                        task.result()
                for name, process in programs.items():
                    looks.setdefault(name, []).append(look(process))
                if loop.time() >= pull_at:
                    pull_at += _MINUTE
                    witness.counts["pulled"] += 1
                    cable.pull()
                    await asyncio.sleep(_GONE)
                    await cable.plug()
                    await asyncio.sleep(_BACK)
    return witness, looks


def run(*, short: bool, hours: float = 2.0) -> Result:
    """Live for so many hours (short: three minutes)."""
    hours, most = (0.05, _MOST_AT_FIRST) if short else (hours, _MOST_GROWTH)
    witness, looks = asyncio.run(_live(hours))
    rows, wrong = [], witness.wrong[:20]
    for name, all_looks in looks.items():
        warm = all_looks[int(len(all_looks) * _WARM) :]
        third = max(1, len(warm) // 3)
        begun, ended = (mean(each.memory for each in part) for part in (warm[:third], warm[-third:]))
        low, high = (pick(each.descriptors for each in warm) for pick in (min, max))
        rows.append((name, f"{ended / 1e6:.1f} MB", f"{ended / begun - 1:+.1%}", f"{low} to {high}"))
        if low != high:
            wrong.append(f"the {name} has had {low} to {high} descriptors")
        if ended > begun * (1 + most):
            wrong.append(f"the memory of the {name} grew by {ended / begun - 1:.1%}")
    for who in ("program", "page"):
        seen = witness.seen.get(who, [])
        if len(seen) != witness.counts["pulled"] or max(seen, default=0.0) > _SEEN_WITHIN:
            wrong.append(f"the {who} saw {len(seen)} of {witness.counts['pulled']} losses, after {seen} s")
    latest = {who: f"{max(seen) * 1000:.0f} ms" for who, seen in witness.seen.items()}
    quote = table(
        f"{hours:g} h of an installation, unplugged {witness.counts['pulled']} times",
        ("program", "memory", "growth", "descriptors"),
        rows,
        notes=[f"{dict(witness.counts)}; a loss was seen after at most {latest}; wrong answers: {len(witness.wrong)}"],
    )
    figures = {"counts": dict(witness.counts), "seen": witness.seen}
    return {"tables": [quote], "wrong": wrong, "figures": figures}
