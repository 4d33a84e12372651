"""Names for boards survive being written and read, and a damaged file is one clear error and is not overwritten."""

from __future__ import annotations

import asyncio
import os
import stat
import sys
import tomllib
from pathlib import Path

import platformdirs
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.discovery.names import Alias, _toml, aliases_path, is_name, load_aliases, resolve_url, save_alias
from servolink.errors import TransportUnavailable

TEXTS = st.text(st.characters(exclude_categories=["Cs"]))


@pytest.fixture(autouse=True)
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = aliases_path()
    assert path.is_relative_to(tmp_path)
    return path


@pytest.mark.parametrize("text", ["left-arm", "a", "Robot_7", "9", "com", "comet", "com3x", "x" * 64])
def test_a_name_is_letters_digits_and_dashes(text: str) -> None:
    assert is_name(text)


@pytest.mark.parametrize(
    "text", ["", "COM3", "com12", "/dev/x", "a b", "virtual://", "a.b", "-a", "é", "a\n", "x" * 65, "٣"]
)
def test_an_address_is_no_name(text: str) -> None:
    assert not is_name(text)


def test_names_are_kept(path: Path) -> None:
    assert load_aliases() == {}
    save_alias("left", Alias("serial:///dev/ttyACM0?baudrate=9600", "A1"))
    save_alias("right", Alias("tcp://pi:9000"))
    save_alias("left", Alias("serial:///dev/ttyACM1", "A2"))
    assert load_aliases() == {"left": Alias("serial:///dev/ttyACM1", "A2"), "right": Alias("tcp://pi:9000")}
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and permissions of POSIX")
def test_names_are_for_their_owner_and_are_not_waited_for(path: Path) -> None:
    save_alias("left", Alias("tcp://pi:9000"))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(TransportUnavailable, match=r"boards\.toml cannot be used: is not a regular file; correct it"):
        load_aliases()
    path.unlink()
    path.write_bytes(b"#" * (1 << 20) + b"\n")
    with pytest.raises(TransportUnavailable, match=r"boards\.toml cannot be used: is larger than 1 MiB"):
        load_aliases()


def test_a_user_without_a_home_has_no_names(monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless(*_: object, **__: object) -> None:
        raise RuntimeError("could not determine the home directory")

    monkeypatch.setattr(platformdirs, "user_config_path", homeless)
    assert load_aliases() == {}
    with pytest.raises(TransportUnavailable, match=r"neither an address nor a name \(none is known\)"):
        asyncio.run(resolve_url("left"))
    with pytest.raises(TransportUnavailable, match=r"names for boards cannot be kept: could not .* set HOME"):
        save_alias("left", Alias("tcp://pi:9000"))


def test_what_editors_put_before_a_text_is_no_part_of_it(path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.write_text('[boards.left]\nurl = "tcp://pi:9000"\n', encoding="utf-8-sig")
    assert load_aliases() == {"left": Alias("tcp://pi:9000")}


@given(TEXTS, TEXTS)
def test_any_text_of_a_device_can_be_kept(url: str, serial_number: str) -> None:
    written = tomllib.loads(_toml({"name": Alias(url, serial_number)}))["boards"]["name"]
    assert (written["url"], written.get("serial_number", "")) == (url, serial_number)


def test_what_a_terminal_would_obey_is_escaped_in_the_file(path: Path) -> None:
    save_alias("left", Alias("serial:///dev/\x9b2J\u202e", "臂"))
    assert path.read_text(encoding="utf-8").endswith(
        '[boards.left]\nurl = "serial:///dev/\\U0000009b2J\\U0000202e"\nserial_number = "臂"\n'
    )


def test_an_address_that_is_no_text_is_refused(path: Path) -> None:
    save_alias("left", Alias("tcp://pi:9000"))
    with pytest.raises(TransportUnavailable, match=r"/dev/\\xff: holds bytes that are not text; write each as in %FF"):
        save_alias("right", Alias("serial:///dev/\udcff"))
    assert load_aliases() == {"left": Alias("tcp://pi:9000")}


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"[boards", "at end of document"),
        (b"\xff", "utf-8"),
        (b"boards = 3", "$.boards"),
        (b"[boards.a]\nurl = 3", "$.boards"),
        (b"[boards.a]\nport = 'x'", "port"),
        (b"[boards.'a b']\nurl = 'x'", "'a b' cannot be a name"),
        (b"[colours]", "colours"),
        (b"x = " + b"[" * 5000, ""),
    ],
)
def test_a_damaged_file_is_one_clear_error_and_is_left_alone(content: bytes, named: str, path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    for use in (load_aliases, lambda: save_alias("b", Alias("virtual://"))):
        with pytest.raises(TransportUnavailable) as refused:
            use()
        assert str(path) in str(refused.value)
        assert named in str(refused.value)
    assert path.read_bytes() == content


def test_a_write_that_fails_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_alias("left", Alias("virtual://"))

    def no_space(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", no_space)
    with pytest.raises(OSError, match="No space"):
        save_alias("right", Alias("virtual://"))
    monkeypatch.undo()
    assert [file.name for file in path.parent.iterdir()] == [path.name]
