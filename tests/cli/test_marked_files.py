"""Text files as editors save them: with a byte order mark and other line ends, or in UTF-16, at every door.

Modules: servolink.support.files, servolink.support.json_text.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.boards import Aliases, ProfileFile
from servolink.errors import ServolinkError
from servolink.fleet import BrokerAccess
from servolink.project import ProjectFile
from servolink.support import user_folder
from tests.cli.programs import call

SAVE = "save the file as UTF-8"
READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "boards.toml": ('[boards.rex]\nurl = "tcp://h:1"\n', lambda path: Aliases.load()["rex"].url),
    "profiles/rex.toml": ('[settings]\nbyte_order = "big"\n', lambda path: ProfileFile("rex").load()),
    "secret": ("sesame\n", lambda path: BrokerAccess.of("mqtt://rex@localhost", password_file=path).password),
    "robot.json": ('{"schema": 1, "project_id": 7}\n', ProjectFile.read),
}


def write(name: str, content: bytes) -> Path:
    path = user_folder("config") / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    path.chmod(0o600)
    return path


@pytest.fixture(autouse=True)
def _home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.mark.parametrize("name", READERS)
def test_marks_and_line_ends_change_nothing(name: str) -> None:
    text, read = READERS[name]
    plain = read(write(name, text.encode()))
    assert plain
    assert read(write(name, text.replace("\n", "\r\n").encode("utf-8-sig"))) == plain


@pytest.mark.parametrize("name", READERS)
def test_a_file_in_another_encoding_is_named_with_the_remedy(name: str) -> None:
    text, read = READERS[name]
    path = write(name, text.encode("utf-16"))
    with pytest.raises((ServolinkError, ValueError), match=SAVE) as caught:
        read(path)
    assert path.name in str(caught.value)
    assert "codec" not in str(caught.value)


def test_frames_in_a_marked_file_are_decoded(capsys: pytest.CaptureFixture[str]) -> None:
    path = write("frames", "13 4c 05 1d 1a 27 01 00 01 c4\r\n".encode("utf-8-sig"))
    said = call(capsys, "decode", "--hex", str(path))
    assert (said.code, said.err) == (0, "")


def test_a_script_of_a_virtual_board_in_another_encoding_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "virtual", "--script", str(write("script", "1 press 3\n".encode("utf-16"))))
    assert said.code == 2
    assert SAVE in said.err
