"""Files with any content are read, or refused by one error that is safe to print.

The functions of `texts` assert that, for these tests and for those that mutate seeds.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import ServolinkError
from servolink.fleet import load_fleet_file
from servolink.project import UNFINISHED
from servolink.protocol import (
    AddActionRequest,
    AddServoParameterRequest,
    Codec,
    ServoParameter,
    Step,
    WriteProjectIDRequest,
)
from servolink.recorder import has_sound_index
from tests.proofs.fuzz import texts
from tests.proofs.fuzz.amounts import examples
from tests.proofs.fuzz.errors import check
from tests.proofs.hostile.corpus import PAYLOADS
from tests.recorder.test_repairing import blocks

_anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from([one.text for one in PAYLOADS]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
_FRAMES = [
    Codec().encode(packet).hex()
    for packet in (
        WriteProjectIDRequest(7),
        AddServoParameterRequest((ServoParameter(1, 2, "knee"), ServoParameter(200, 0, "x"))),
        AddActionRequest(3, "wave", (Step(1, 2, 3),)),
    )
]


@st.composite
def spoilt(draw: st.DrawFn, whole: Any) -> Any:
    """Draw `whole` with anything in one place."""
    if not isinstance(whole, (dict, list)) or not whole or draw(st.integers(0, 3)) == 0:
        return draw(_anything)
    key = draw(st.sampled_from(sorted(whole) if isinstance(whole, dict) else range(len(whole))))
    changed = whole.copy()
    changed[key] = draw(spoilt(whole[key]))
    return changed


def files(whole: Any, written: Callable[[Any], bytes]) -> st.SearchStrategy[bytes]:
    """Draw the bytes of a file with `whole`, with nearly that, or with anything."""
    return st.binary(max_size=200) | spoilt(whole).map(written) | st.just(written(whole))


def as_json(said: Any) -> bytes:
    """Write JSON."""
    return json.dumps(said).encode()


def as_lines(said: Any) -> bytes:
    """Write JSON, a line for each part."""
    return b"".join(as_json(line) + b"\n" for line in said) if isinstance(said, list) else as_json(said)


_RECORDING = [{"t": 0.1, "sent": "134c"}, {"t": 0.2, "received": "00"}, {"t": 0.3, "lost": "it is gone"}]
_STATE = {"byte_order": "little", "battery": 900.0, "angles": {"1": 5.0}, "requests": _FRAMES}
_MARKER = UNFINISHED.start + 7
_JOURNAL = {
    "marker": _MARKER,
    "url": "serial:///dev/\udcff",
    "caption_encoding": "utf-8",
    "project_id": 5,
    "backup": "000001-20260102T030405Z-board-0123456789ab.servolink.json",
    "phase": "writing",
}
_MCAP = b"".join(blocks(2, 3))
_BOARD = {"url": "tcp://127.0.0.1:1", "product": "board", "serial_number": "", "problem": ""}


@examples(60)
@given(files(_RECORDING, as_lines))
def test_a_recording(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file").write_bytes(content)
    texts.check_recording(tmp_path / "file")


@examples(200)
@given(st.integers(0, 1 << 20), st.binary(max_size=8) | st.integers(0, 7))
def test_a_recording_for_other_programs(tmp_path: Path, at: int, change: bytes | int) -> None:
    spoilt_file = bytearray(_MCAP)
    at %= len(_MCAP)
    if isinstance(change, int):
        spoilt_file[at] ^= 1 << change
    else:
        spoilt_file[at : at + len(change)] = change
    (tmp_path / "file").write_bytes(spoilt_file)
    assert has_sound_index(tmp_path / "file") in {True, False}


@examples(60)
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda table, key, value: f"[{table}]\n{key} = {json.dumps(value)}\n".encode(),
        st.sampled_from(["default", "boards.rex", "default.angles", "groups", '"boards.\u202e"']),
        st.sampled_from(["allow", "max_speed", "angles", "1", "all", '"x\u001b"']),
        _anything,
    )
)
def test_the_policy_of_a_fleet(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file").write_bytes(content)
    try:
        load_fleet_file(tmp_path / "file")
    except ServolinkError as error:
        check(error)


@examples(60)
@given(files(_STATE, as_json))
def test_what_a_virtual_board_has_kept(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file").write_bytes(content)
    texts.check_saved_board(tmp_path / "file")


@examples(60)
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda name, key, value: f"[boards.{name}]\n{key} = {json.dumps(value)}\n".encode(),
        st.sampled_from(["left", '"x\\u001b"', '"a b"', "com1"]),
        st.sampled_from(["url", "serial_number", "port", '"\\u202e"']),
        _anything,
    )
)
def test_names_of_boards(tmp_path: Path, content: bytes) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        texts.check_names_of_boards(content)


@examples(100)
@given(
    st.binary(max_size=200)
    | st.builds(
        lambda table, key, value: f"# \n[{table}]\n{key} = {json.dumps(value)}\n".encode(),
        st.sampled_from(["identity", "settings", "limits", "limits.angles", "limits.speed_caps", "evidence.depth"]),
        st.sampled_from(["servo_ids", "serial_number", "depth", "unsupported", "turnaround", "3", '"\u202e"', "text"]),
        _anything,
    )
)
def test_the_profile_of_a_board(tmp_path: Path, content: bytes) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        texts.check_profile_of_a_board(content)


@examples(60)
@given(files(_JOURNAL, as_json))
def test_the_journal_of_an_import(tmp_path: Path, content: bytes) -> None:
    texts.check_journal(content, tmp_path, _MARKER)


@examples(60)
@given(files(_BOARD, as_json))
def test_what_a_served_board_says_of_itself(tmp_path: Path, content: bytes) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        (tmp_path / "servolink").mkdir(mode=0o700, exist_ok=True)
        (tmp_path / "servolink/x.board").write_bytes(content)
        texts.check_announcement(tmp_path / "servolink/x.board")
