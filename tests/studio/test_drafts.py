"""Drafts are kept record by record: on the disk before they are confirmed, and never over somebody else's edit."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import EncodeError, ProjectError
from servolink.studio.drafts import MOST_RECORDS, Drafts, Edit, Kept, draft_path
from tests import processes

ACTION = {"action_id": 3, "action_caption": "bow", "steps": [{"servo_id": 1, "degree": 40, "interval_ms": 500}]}
BOW = {**ACTION, "action_caption": "deep bow"}
JUMP = {**ACTION, "action_caption": "jump"}


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return tmp_path


def save(*edits: Edit, who: str = "Tablet 2", board: str = "robbie") -> tuple[tuple[Kept, ...], tuple[Kept, ...]]:
    return asyncio.run(Drafts(board).save(list(edits), who))


def kept(board: str = "robbie") -> list[Kept]:
    return list(asyncio.run(Drafts(board).kept()))


def action(record: Any, known: int = 0, **others: Any) -> Edit:
    return Edit("actions", 3, known, ACTION, record, **others)


def test_an_edit_is_kept_for_its_board() -> None:
    assert kept() == []
    saved, conflicts = save(action(BOW))
    assert (saved, conflicts) == ((Kept("actions", 3, 1, "Tablet 2", ACTION, BOW),), ())
    assert kept() == list(saved)
    assert kept("another") == []


def test_an_edit_from_an_older_revision_is_a_conflict() -> None:
    ((first,), _) = save(action(BOW))
    ((second,), _) = save(action(JUMP, known=first.revision), who="Tablet 1")
    assert save(action(BOW, known=first.revision)) == ((), (second,))
    assert save(action(BOW)) == ((), (second,))
    assert kept() == [second]


def test_a_conflict_keeps_no_other_record_from_being_saved() -> None:
    save(action(BOW))
    macro = Edit("macros", 1, 0, None, {"macro_id": 1, "macro_caption": "", "commands": []})
    saved, conflicts = save(action(JUMP), macro)
    assert [one.kind for one in saved] == ["macros"]
    assert [one.kind for one in conflicts] == ["actions"]
    assert {one.kind for one in kept()} == {"actions", "macros"}


def test_what_another_studio_keeps_is_news_once() -> None:
    here, there = Drafts("robbie"), Drafts("robbie")

    async def test() -> None:
        await here.save([action(BOW)], "Tablet 1")
        assert await here.news() == ()
        (first,) = await there.news()
        ((second,), _) = await there.save([action(JUMP, known=first.revision)], "Tablet 2")
        assert await there.news() == ()
        assert await here.news() == (second,)
        assert await here.news() == ()
        draft_path("robbie").unlink()
        ((third,), _) = await there.save([action(BOW)], "Tablet 2")
        assert await here.news() == (third,)

    asyncio.run(test())


def test_the_same_edit_twice_is_no_conflict() -> None:
    save(action(BOW))
    saved, conflicts = save(action(BOW), who="Tablet 1")
    assert (len(saved), conflicts) == (1, ())


def test_an_edit_that_was_given_up_is_a_revision_too() -> None:
    ((first,), _) = save(action(BOW))
    ((gone,), _) = save(action(None, known=first.revision, is_discarded=True))
    assert (gone.is_discarded, gone.record) == (True, None)
    assert save(action(JUMP, known=first.revision))[1] == (gone,)
    assert len(save(action(JUMP, known=gone.revision))[0]) == 1


def test_a_removed_record_and_the_active_table_are_kept() -> None:
    save(action(None), Edit("active_joystick_table", 0, 0, 1, 2))
    assert [(one.kind, one.base, one.record) for one in kept()] == [
        ("actions", ACTION, None),
        ("active_joystick_table", 1, 2),
    ]


@pytest.mark.parametrize(
    "edit",
    [
        Edit("actions", 3, 0, None, {"action_id": "3"}),
        Edit("actions", 3, 0, {"steps": 1}, None),
        Edit("actions", 3, 0, None, []),
        Edit("active_joystick_table", 0, 0, None, "1"),
    ],
)
def test_what_is_no_record_is_refused(edit: Edit) -> None:
    with pytest.raises(EncodeError, match=r"edits\[1\]"):
        save(action(BOW), edit)
    assert kept() == []


def test_a_caption_with_a_byte_that_is_not_text_is_kept() -> None:
    record = {**ACTION, "action_caption": "bow\udcff"}
    save(action(record))
    assert kept()[0].record == record


def test_a_damaged_file_is_put_aside() -> None:
    save(action(BOW))
    path = draft_path("robbie")
    for content in (b"{", b"[]", b'{"draft": 2}', b"\xff", b"[" * 100_000):
        path.write_bytes(content)
        assert kept() == []
        assert path.with_suffix(".damaged").read_bytes() == content
        assert len(save(action(BOW))[0]) == 1


def test_a_file_that_cannot_be_written_is_said() -> None:
    path = draft_path("robbie")
    path.parent.parent.mkdir(parents=True, exist_ok=True)
    path.parent.write_text("a file where the folder is to be")
    with pytest.raises(ProjectError, match="the draft cannot be"):
        save(action(BOW))


@pytest.mark.parametrize("board", ["robbie", "../../etc/passwd", "a" * 500, "C:\\robbie", "\x00", "com1", ""])
def test_drafts_of_all_names_are_in_one_folder(board: str, data: Path) -> None:
    assert draft_path(board).parent == data / "servolink" / "drafts"
    save(action(BOW), board=board)
    assert len(kept(board)) == 1


def test_the_oldest_edits_that_were_given_up_are_forgotten_first() -> None:
    def edit(number: int, *, is_discarded: bool) -> Edit:
        return Edit("actions", number, 0, is_discarded=is_discarded)

    save(*(edit(number, is_discarded=number < 10) for number in range(MOST_RECORDS)))
    save(*(edit(MOST_RECORDS + number, is_discarded=False) for number in range(9)))
    assert len(kept()) == MOST_RECORDS
    assert [one.id for one in kept() if one.is_discarded] == [9]
    with pytest.raises(ProjectError, match="at most"):
        save(*(edit(2 * MOST_RECORDS + number, is_discarded=False) for number in range(2)))


@pytest.mark.slow
def test_several_studios_of_one_board_lose_none_of_their_edits() -> None:
    program = (
        "import asyncio, sys\n"
        "from servolink.studio.drafts import Drafts, Edit\n"
        "async def main(mine):\n"
        "    drafts = Drafts('robbie')\n"
        "    for number in range(40):\n"
        "        edits = [Edit('actions', mine + number, 0, is_discarded=True), Edit('project_id', 0, 0, None, mine)]\n"
        "        print(len((await drafts.save(edits, 'a page'))[1]))\n"
        "asyncio.run(main(int(sys.argv[1])))\n"
    )
    programs = [processes.start([sys.executable, "-c", program, str(mine)]) for mine in (1000, 2000)]
    conflicts = [sum(map(int, processes.finish(each)[0].split())) for each in programs]
    assert len(kept()) == 2 * 40 + 1
    (project,) = [one for one in kept() if one.kind == "project_id"]
    loser = 0 if project.record == 2000 else 1
    assert (conflicts[loser], conflicts[1 - loser]) == (40, 0)  # each record belongs to who came first


def test_what_was_confirmed_survives_a_kill() -> None:
    program = (
        "import asyncio, os, signal\n"
        "from servolink.studio.drafts import Drafts, Edit\n"
        f"record = {ACTION!r}\n"
        "async def main():\n"
        "    saved, _ = await Drafts('robbie').save([Edit('actions', 3, 0, None, record)], 'Tablet 2')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
        "asyncio.run(main())\n"
    )
    ended = processes.run([sys.executable, "-c", program])
    assert ended.returncode == -signal.SIGKILL
    assert [one.record for one in kept()] == [ACTION]
    assert json.loads(draft_path("robbie").read_bytes())["revision"] == 1
