"""The log of commands."""

from __future__ import annotations

import asyncio
import errno
from pathlib import Path

import pytest

from servolink.errors import OpenError
from servolink.fleet import command_log as module
from servolink.fleet.command_log import CommandLog, LogEntry, opened_command_log

pytestmark = pytest.mark.usefixtures("user")


def noted(command_log: CommandLog, *ids: str, only_reads: bool = False) -> None:
    async def main() -> None:
        notes = (command_log.note(LogEntry(each, "d", 1.0, "t", b"\x00"), only_reads=only_reads) for each in ids)
        await asyncio.gather(*notes)

    asyncio.run(main())


def test_a_command_is_known_after_a_crash() -> None:
    with opened_command_log("rex") as command_log:
        noted(command_log, "a", "b", "c")
        command_log.answered("b", '{"ok":true}')
        command_log.over("c")
        again = CommandLog(command_log._path)  # as another program reads it after a crash
        again.open()
    assert [entry.id for entry in again.unfinished()] == ["a", "b"]
    assert (again.unfinished()[0].response_topic, again.unfinished()[0].correlation) == ("t", b"\x00")
    assert again.unfinished()[1].answer == '{"ok":true}'
    assert again.find("c") is not None
    assert again.find("d") is None
    again.close()


def test_commands_that_come_together_are_written_together(monkeypatch: pytest.MonkeyPatch) -> None:
    writes: list[int] = []
    write = CommandLog._write

    def counted(command_log: CommandLog, lines: list[bytes]) -> None:
        writes.append(len(lines))
        write(command_log, lines)

    monkeypatch.setattr(CommandLog, "_write", counted)
    with opened_command_log("rex") as command_log:
        noted(command_log, *map(str, range(20)))
    assert sum(writes) == 20
    assert len(writes) <= 2  # the first, and all that came while it was being written


def test_commands_of_a_batch_that_cannot_be_written_are_all_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    writes = iter([True, False, True])
    write = CommandLog._write

    def full(command_log: CommandLog, lines: list[bytes]) -> None:
        if not next(writes):
            raise OSError(errno.ENOSPC, "No space left on device")
        write(command_log, lines)

    async def main(command_log: CommandLog) -> None:
        first = asyncio.ensure_future(command_log.note(LogEntry("first")))
        while command_log._buffer:
            await asyncio.sleep(0)
        batch = [command_log.note(LogEntry(each)) for each in ("a", "b", "c")]
        assert all(command_log.find(each) for each in ("first", "a", "b", "c")), "at once"
        outcomes = await asyncio.gather(first, *batch, return_exceptions=True)
        assert [type(each) for each in outcomes] == [type(None), OSError, OSError, OSError]
        assert not any(command_log.find(each) for each in ("a", "b", "c"))
        await command_log.note(LogEntry("last"))

    monkeypatch.setattr(CommandLog, "_write", full)
    with opened_command_log("rex") as command_log:
        asyncio.run(main(command_log))
        again = CommandLog(command_log._path)
        again.open()
        assert [entry.id for entry in again.unfinished()] == ["first", "last"]
        again.close()


def test_one_who_waits_no_longer_keeps_nobody_from_being_noted() -> None:
    async def main(command_log: CommandLog) -> None:
        given_up, other = (asyncio.ensure_future(command_log.note(LogEntry(each))) for each in "ab")
        given_up.cancel()
        await other
        assert command_log.find("a"), "it is on the disk"

    with opened_command_log("rex") as command_log:
        asyncio.run(main(command_log))


def test_a_command_log_belongs_to_one_program() -> None:
    again = opened_command_log("rex")
    with (
        opened_command_log("rex"),
        opened_command_log("fido"),
        pytest.raises(OpenError, match="connects rex with a broker"),
    ):
        again.__enter__()


def test_what_only_reads_is_known_after_a_crash_and_does_not_wait_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    with opened_command_log("rex") as command_log:
        monkeypatch.setattr(CommandLog, "_write", None)
        noted(command_log, "a", "b", only_reads=True)
        again = CommandLog(command_log._path)
        again.open()
    assert [entry.id for entry in again.unfinished()] == ["a", "b"]
    again.close()


@pytest.mark.parametrize("only_reads", [False, True])
def test_a_journal_stays_small(monkeypatch: pytest.MonkeyPatch, only_reads: bool) -> None:
    monkeypatch.setattr(module, "MOST_KEPT", 10)
    monkeypatch.setattr(module, "_ALWAYS_KEPT", 3)
    with opened_command_log("rex") as command_log:
        for number in range(100):
            noted(command_log, f"n{number}", only_reads=only_reads)
            command_log.over(f"n{number}")
        assert command_log.find("n89") is None
        assert command_log.find("n90") is not None
        assert command_log._path.stat().st_size < 10_000
    with opened_command_log("rex") as command_log:  # all are of 1970: only the latest are kept
        assert [number for number in range(100) if command_log.find(f"n{number}")] == [97, 98, 99]


def test_a_line_that_was_cut_spoils_no_other(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(b'\n{"id":"a"}\n\n{"id":"b","dig\n{"id":"c"}\n\xff\n')
    command_log = CommandLog(path)
    command_log.open()
    assert [entry.id for entry in command_log.unfinished()] == ["a", "c"]
    command_log.close()


def test_a_folder_that_cannot_be_written_is_an_error(user: Path) -> None:
    (user / "XDG_DATA_HOME" / "servolink").write_text("a file", encoding="utf-8")
    with pytest.raises(OpenError, match="the commands of rex cannot be noted: "), opened_command_log("rex"):
        pass
