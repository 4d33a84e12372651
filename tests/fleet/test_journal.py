"""The journal of commands."""

from __future__ import annotations

import asyncio
import errno
from pathlib import Path

import pytest

from servolink.errors import OpenError
from servolink.fleet import journal as module
from servolink.fleet.journal import Entry, Journal, opened_journal

pytestmark = pytest.mark.usefixtures("user")


def noted(journal: Journal, *ids: str, only_reads: bool = False) -> None:
    async def main() -> None:
        notes = (journal.note(Entry(each, "d", 1.0, "t", b"\x00"), only_reads=only_reads) for each in ids)
        await asyncio.gather(*notes)

    asyncio.run(main())


def test_a_command_is_known_after_a_crash() -> None:
    with opened_journal("rex") as journal:
        noted(journal, "a", "b", "c")
        journal.answered("b", '{"ok":true}')
        journal.over("c")
        again = Journal(journal._path)  # as another program reads it after a crash
        again.open()
    assert [entry.id for entry in again.unfinished()] == ["a", "b"]
    assert (again.unfinished()[0].response_topic, again.unfinished()[0].correlation) == ("t", b"\x00")
    assert again.unfinished()[1].answer == '{"ok":true}'
    assert again.find("c") is not None
    assert again.find("d") is None
    again.close()


def test_commands_that_come_together_are_written_together(monkeypatch: pytest.MonkeyPatch) -> None:
    writes: list[int] = []
    write = Journal._write

    def counted(journal: Journal, lines: list[bytes]) -> None:
        writes.append(len(lines))
        write(journal, lines)

    monkeypatch.setattr(Journal, "_write", counted)
    with opened_journal("rex") as journal:
        noted(journal, *map(str, range(20)))
    assert sum(writes) == 20
    assert len(writes) <= 2  # the first, and all that came while it was being written


def test_commands_of_a_batch_that_cannot_be_written_are_all_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    writes = iter([True, False, True])
    write = Journal._write

    def full(journal: Journal, lines: list[bytes]) -> None:
        if not next(writes):
            raise OSError(errno.ENOSPC, "No space left on device")
        write(journal, lines)

    async def main(journal: Journal) -> None:
        first = asyncio.ensure_future(journal.note(Entry("first")))
        while journal._buffer:
            await asyncio.sleep(0)
        batch = [journal.note(Entry(each)) for each in ("a", "b", "c")]
        assert all(journal.find(each) for each in ("first", "a", "b", "c")), "at once"
        outcomes = await asyncio.gather(first, *batch, return_exceptions=True)
        assert [type(each) for each in outcomes] == [type(None), OSError, OSError, OSError]
        assert not any(journal.find(each) for each in ("a", "b", "c"))
        await journal.note(Entry("last"))

    monkeypatch.setattr(Journal, "_write", full)
    with opened_journal("rex") as journal:
        asyncio.run(main(journal))
        again = Journal(journal._path)
        again.open()
        assert [entry.id for entry in again.unfinished()] == ["first", "last"]
        again.close()


def test_one_who_waits_no_longer_keeps_nobody_from_being_noted() -> None:
    async def main(journal: Journal) -> None:
        given_up, other = (asyncio.ensure_future(journal.note(Entry(each))) for each in "ab")
        given_up.cancel()
        await other
        assert journal.find("a"), "it is on the disk"

    with opened_journal("rex") as journal:
        asyncio.run(main(journal))


def test_a_journal_belongs_to_one_program() -> None:
    again = opened_journal("rex")
    with opened_journal("rex"), opened_journal("fido"), pytest.raises(OpenError, match="connects rex with a broker"):
        again.__enter__()


def test_what_only_reads_is_known_after_a_crash_and_does_not_wait_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened_journal("rex") as journal:
        monkeypatch.setattr(Journal, "_write", None)
        noted(journal, "a", "b", only_reads=True)
        again = Journal(journal._path)
        again.open()
    assert [entry.id for entry in again.unfinished()] == ["a", "b"]
    again.close()


@pytest.mark.parametrize("only_reads", [False, True])
def test_a_journal_stays_small(monkeypatch: pytest.MonkeyPatch, only_reads: bool) -> None:
    monkeypatch.setattr(module, "MOST_KEPT", 10)
    monkeypatch.setattr(module, "_ALWAYS_KEPT", 3)
    with opened_journal("rex") as journal:
        for number in range(100):
            noted(journal, f"n{number}", only_reads=only_reads)
            journal.over(f"n{number}")
        assert journal.find("n89") is None
        assert journal.find("n90") is not None
        assert journal._path.stat().st_size < 10_000
    with opened_journal("rex") as journal:  # all are of 1970: only the latest are kept
        assert [number for number in range(100) if journal.find(f"n{number}")] == [97, 98, 99]


def test_a_line_that_was_cut_spoils_no_other(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(b'\n{"id":"a"}\n\n{"id":"b","dig\n{"id":"c"}\n\xff\n')
    journal = Journal(path)
    journal.open()
    assert [entry.id for entry in journal.unfinished()] == ["a", "c"]
    journal.close()


def test_a_folder_that_cannot_be_written_is_an_error(user: Path) -> None:
    (user / "XDG_DATA_HOME" / "servolink").write_text("a file", encoding="utf-8")
    with pytest.raises(OpenError, match="the commands of rex cannot be noted: "), opened_journal("rex"):
        pass
