"""Imports: how long they take, and how they end if the cable is pulled at each byte, at random places, on bad lines.

In virtual time, against virtual boards of every make. Nothing may be lost, and each import must end with the new
project on the board, or after a rollback with the old one; the naive import, delete all and write all, beside it.
"""

from __future__ import annotations

import asyncio
import logging
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

from benchmarks.measuring import Result, table
from servolink.client import Board
from servolink.protocol import RECORD_TYPES
from servolink.transports import Faults
from tests.project.cable import Cable
from tests.project.pulled import (
    DEEP_MAKES,
    MAKES,
    NEW,
    NEW_CONTENTS,
    OLD_CONTENTS,
    WEAK_MAKES,
    History,
    Make,
    Pull,
    attempt,
    bytes_of_import,
    same,
)
from tests.proofs.import_speed import measure
from tests.virtual_time import VirtualTimeLoop

BAD_LINE = Faults(flip=0.0003, drop=0.0001, delay=0.01, delay_time=1.3)
_EACH_BYTE = [
    Make("replace", "all", partial_writes=True, bus_powered=True),
    Make("append", "records", partial_writes=True, bus_powered=True),
    Make("reject", "all", partial_writes=True, bus_powered=True),
]
_EACH, _TWICE, _BAD = "pulled at each byte", "pulled at two random bytes", "pulled likewise, on a bad line"
_DEEP, _WEAK = "pulled likewise, several requests under way", "pulled once, less than 32 bits of a project id"
_COUNTS = {_TWICE: 12_000, _BAD: 6_000, _DEEP: 6_000, _WEAK: 4_000}
_SHORT = 40
_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder in it, made by tempfile


def run(*, short: bool) -> Result:
    """Run all histories, or a few of each sort, and time imports."""
    speed = measure(short=short)
    logging.getLogger("servolink.project").setLevel(logging.ERROR)  # what is left of torn records is saved, and said
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        bench = _Bench(runner)
        counts = {name: bench.judge(name, histories) for name, histories in bench.sorts(short=short)}
        naive = bench.naive(short=short)
        shutil.rmtree(bench.folder)
    rows = [[name, *(f"{count[word]:,}" for word in _WORDS), count["most"]] for name, count in counts.items()]
    share = f"{naive[0]:,} of {naive[1]:,} places ({100 * naive[0] / naive[1]:.1f} %)"
    notes = [
        "In virtual time, on virtual boards of every kind.",
        "From the state in which the last pull left board and files, the import is repeated once and rolled back once.",
        f"Delete all and write all, pulled at each byte: neither project on the board at {share}.",
    ]
    columns = ["import", *_WORDS, "connections after the last pull, most"]
    wrong = [f"{name}: {count[word]} {word}" for name, count in counts.items() for word in _WRONG if count[word]]
    wrong += [
        f"{name}: {count['most']} connections" for name, count in counts.items() if name != _BAD and count["most"] > 1
    ]
    return {
        "counts": {name: dict(count) for name, count in counts.items()},
        "naive_neither": naive[0],
        "naive_places": naive[1],
        "wrong": wrong,
        "seconds": speed["seconds"],
        "goals": speed["goals"],
        "tables": [*speed["tables"], table("Imports with the cable pulled", columns, rows, notes)],
    }


_WRONG = ("lost", "wrong after applying", "wrong after rolling back")
_WORDS = ("histories", "pulls", *_WRONG)


class _Bench:
    def __init__(self, runner: asyncio.Runner) -> None:
        self._runner = runner
        self._random = Random(1)
        self.folder = Path(tempfile.mkdtemp(dir=_MEMORY if _MEMORY.is_dir() else None))
        self._sizes: dict[tuple[Make, bool], tuple[int, int]] = {}

    def sorts(self, *, short: bool) -> Iterator[tuple[str, Iterator[History]]]:
        """Yield name and histories of each sort."""
        each = (self._history(make, replace, byte) for make, replace, byte in self._each_byte(short=short))
        yield _EACH, each
        for name, faults in ((_TWICE, None), (_BAD, BAD_LINE)):
            yield name, (self._drawn(2, faults) for _ in range(_SHORT if short else _COUNTS[name]))
        for name, pulls, makes in ((_DEEP, 2, DEEP_MAKES), (_WEAK, 1, WEAK_MAKES)):
            yield name, (self._drawn(pulls, makes=makes) for _ in range(_SHORT if short else _COUNTS[name]))

    def judge(self, name: str, histories: Iterator[History]) -> Counter[str]:
        """Run `histories` and count what became of them."""
        self._random = Random(name)
        count: Counter[str] = Counter(dict.fromkeys((*_WORDS, "most"), 0))
        for history in histories:
            folder = self.folder / "one"
            verdict = self._runner.run(history.judge(folder))
            for left in self.folder.iterdir():
                shutil.rmtree(left)
            count["histories"] += 1
            count["pulls"] += len(history.pulls)
            count["lost"] += verdict.lost
            count["wrong after applying"] += not verdict.new
            count["wrong after rolling back"] += not verdict.old
            count["most"] = max(count["most"], verdict.connections)
            if not verdict.right:
                print(f"{name}: {history}: {verdict}")  # it reproduces exactly
        return count

    def naive(self, *, short: bool) -> tuple[int, int]:
        """Return at how many places a pulled naive import leaves neither project, and how many places there are."""
        make = MAKES[0]
        whole = Cable(make.board(OLD_CONTENTS, 0))
        self._runner.run(attempt(whole, _erase_and_write))
        places = range(0, whole.sent + whole.received, 20 if short else 1)
        neither = 0
        for byte in places:
            pull = Pull.at(byte, (whole.sent, whole.received))
            board = make.board(OLD_CONTENTS, 0)
            self._runner.run(attempt(Cable(board, sent=pull.sent, received=pull.received), _erase_and_write))
            left = board.storage.contents
            neither += not same(left, OLD_CONTENTS) and not same(left, NEW_CONTENTS)
        return neither, len(places)

    def _each_byte(self, *, short: bool) -> Iterator[tuple[Make, bool, int]]:
        for make in _EACH_BYTE:
            for replace in (False, True):
                for byte in range(0, sum(self._size(make, replace=replace)), 907 if short else 1):
                    yield make, replace, byte

    def _size(self, make: Make, *, replace: bool) -> tuple[int, int]:
        if (make, replace) not in self._sizes:
            work = bytes_of_import(make, whole=replace, folder=self.folder / "size")
            self._sizes[make, replace] = self._runner.run(work)
        return self._sizes[make, replace]

    def _history(self, make: Make, replace: bool, *bytes_: int, faults: Faults | None = None) -> History:
        pulls = tuple(Pull.at(byte, self._size(make, replace=replace)) for byte in bytes_)
        seed = self._random.randrange(2**32)
        return History(make, replace, pulls, seed, *([faults] if faults else []))

    def _drawn(self, pulls: int, faults: Faults | None = None, makes: Sequence[Make] = MAKES) -> History:
        make, replace = self._random.choice(makes), self._random.random() < 0.5
        size = sum(self._size(make, replace=replace))
        return self._history(make, replace, *(self._random.randrange(size) for _ in range(pulls)), faults=faults)


async def _erase_and_write(board: Board) -> None:
    """Import as the document says, and no more."""
    await board.clear_all_data()
    await board.write_project_id(NEW.project_id)
    await board.add_servo_parameters(NEW.servo_parameters)
    for record_type in RECORD_TYPES:
        for record in record_type.by_id(NEW).values():
            await board.request(record_type.add(record))
    if NEW.active_joystick_table is not None:
        await board.set_active_joystick_table(NEW.active_joystick_table)
