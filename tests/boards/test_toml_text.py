"""TOML files that people edit: a change by a command leaves everything else byte for byte.

Modules: servolink.boards.toml_changes, servolink.boards.toml_text.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from servolink.boards.names import Alias, Aliases
from servolink.boards.profile import BoardProfile, BoardSettings, Evidence, SafetyLimits
from servolink.boards.store import ProfileFile
from servolink.boards.toml_text import TextError, changed_toml
from servolink.errors import ProfileError
from tests import processes

NAMES = """\
# robots of room 7

[boards.left]   # the one with the blue cable
url   =   'tcp://pi:9000'  # moved in May

# never without the teacher
[boards.right]
url = "serial:///dev/ttyUSB0"
serial_number = "臂"
vendor_id = 0x1a86 # the adapter
"""
PROFILE = """\
# by hand
[settings]
depth=4   # four at most
# byte_order =
unsupported = [
    "QueryMemorySize",  # since 2019
]

# the arm hits the table below 20
[limits.angles]
"3" = [20,160]
4   = [ 0, 90 ]

# end
"""
ODD_FORMS = (
    'settings = {depth = 4, byte_order = "big"} # inline\n',
    "settings.depth = 4\nsettings.byte_order = 'big'\n",
    "[ settings ]\n'depth' = 4\n\"byte_order\" = '''big'''\n[limits]\n",
    "[limits]\nspeed_cap = 1_00\n[settings]\ndepth = 4\nbyte_order = 'big'",
)
VALUES = st.recursive(
    st.text(st.characters(exclude_categories=["Cs"])) | st.integers(-(2**31), 2**31),
    lambda inner: st.dictionaries(st.from_regex("[a-z]{1,3}", fullmatch=True), inner, max_size=3),
    max_leaves=6,
)
TABLES = st.dictionaries(st.from_regex("[a-z]{1,3}", fullmatch=True), VALUES, max_size=4)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def written(path: Path, text: str) -> Path:
    """Write `text` as it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_name_changes_and_everything_else_stays(newline: str, mark: str) -> None:
    path = written(Aliases.path(), mark + NAMES.replace("\n", newline))
    Aliases.save("left", Alias("tcp://pi:9001"))
    expected = NAMES.replace("'tcp://pi:9000'", '"tcp://pi:9001"')
    assert path.read_bytes().decode() == mark + expected.replace("\n", newline)
    Aliases.save("new", Alias("tcp://pi:1"))
    assert path.read_bytes().decode() == mark + f'{expected}\n[boards.new]\nurl = "tcp://pi:1"\n'.replace("\n", newline)


def test_a_removed_name_leaves_the_comments_of_the_next_one() -> None:
    path = written(Aliases.path(), NAMES)
    Aliases.remove("left")
    head, _, rest = NAMES.partition("[boards.left]")
    assert path.read_bytes().decode() == head + rest[rest.index("# never") :]
    assert list(Aliases.load()) == ["right"]


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_a_setting_changes_and_everything_else_stays(newline: str) -> None:
    path = written(ProfileFile("rex").path, PROFILE.replace("\n", newline))
    profile = ProfileFile("rex").load()
    assert profile is not None
    assert profile.limits.angles == {3: (20, 160), 4: (0, 90)}
    settings = BoardSettings(depth=2, byte_order="big", unsupported=profile.settings.unsupported)
    limits = SafetyLimits(angles={**profile.limits.angles, 4: (5, 90)})
    ProfileFile("rex").save(BoardProfile(settings=settings, limits=limits))
    expected = PROFILE.replace("depth=4", "depth=2").replace("# byte_order =", 'byte_order = "big"')
    expected = expected.replace("4   = [ 0, 90 ]", "4   = [5, 90]").replace("\n", newline)
    assert path.read_bytes().decode().startswith(expected.partition("# end")[0])
    assert f"{newline}# end{newline}" in path.read_bytes().decode()


def test_a_setting_that_becomes_unknown_has_a_line_without_a_value_and_comes_back_there() -> None:
    known = BoardProfile(settings=BoardSettings(depth=4, memory_unit=1024))
    path = ProfileFile("rex").save(known)
    text = path.read_bytes()
    ProfileFile("rex").save(BoardProfile(settings=BoardSettings(memory_unit=1024)))
    assert path.read_bytes() == text.replace(b"depth = 4", b"# depth =")
    ProfileFile("rex").save(known)
    assert path.read_bytes() == text


@pytest.mark.parametrize("text", ODD_FORMS)
def test_each_form_of_a_table_can_be_changed(text: str) -> None:
    written(ProfileFile("rex").path, text)
    found = ProfileFile("rex").load()
    assert found is not None
    assert (found.settings.depth, found.settings.byte_order) == (4, "big")
    profile = BoardProfile(
        settings=BoardSettings(depth=7, clear_seconds=1.5),
        limits=SafetyLimits(speed_caps={3: 90}),
        evidence={"depth": Evidence("certain", 'a "text"\n[settings]\x1b\u202e')},
    )
    ProfileFile("rex").save(profile)
    assert ProfileFile("rex").load() == profile


def test_the_same_profile_changes_nothing() -> None:
    path = ProfileFile("rex").save(BoardProfile(settings=BoardSettings(depth=4)))
    text = path.read_bytes() + b"\n# mine"
    path.write_bytes(text)
    found = ProfileFile("rex").load()
    assert found is not None
    ProfileFile("rex").save(found)
    assert path.read_bytes() == text + b"\n"


@pytest.mark.parametrize("flag", [True, False])
def test_a_flag_is_left_or_changed(flag: bool) -> None:
    text = "ignore_extra = true # by the makers\n"
    assert changed_toml(text, {"ignore_extra": flag}) == text.replace("true", str(flag).lower())


def test_a_file_that_cannot_be_changed_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    path = ProfileFile("rex").save(BoardProfile())
    text = path.read_bytes()
    monkeypatch.setattr("servolink.boards.store.changed_toml", lambda text, _: text)
    with pytest.raises(ProfileError, match="has a form that cannot be changed by a command"):
        ProfileFile("rex").save(BoardProfile(settings=BoardSettings(depth=4)))
    assert path.read_bytes() == text


def without_empty(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables without those that hold nothing, which need not be written."""
    inner = {name: without_empty(value) if isinstance(value, dict) else value for name, value in tables.items()}
    return {name: value for name, value in inner.items() if value != {}}


@given(TABLES, TABLES)
@example({"a": {}, "b": "0"}, {"b": {}})
@example({"a": "", "b": {}}, {"a": {}})
def test_any_tables_become_any_others(before: dict[str, Any], after: dict[str, Any]) -> None:
    text = changed_toml("", before)
    assert without_empty(tomllib.loads(text)) == without_empty(before)
    assert without_empty(tomllib.loads(changed_toml(text, after))) == without_empty(after)


def test_tomlkit_is_loaded_only_when_a_file_is_written() -> None:
    program = "import sys, servolink.boards.names, servolink.boards.store; print('tomlkit' in sys.modules)"
    assert processes.run([sys.executable, "-c", program], check=True).stdout == "False\n"


LINES = "# c\n[a]\nx = [\n 1,\n]\ny = '''\nq = 1\n'''\n[a.b]\nz.w = 3\n"


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("path", "line"), [("a", 2), ("a x", 3), ("a y", 6), ("a b", 9), ("a b z w", 10), ("a b none", 9), ("q", 1)]
)
def test_a_value_has_the_number_of_its_first_line(newline: str, path: str, line: int) -> None:
    assert TextError.at(path.split(), LINES.replace("\n", newline), "is wrong").line == line
