"""The comparison with other parsers: fair on a clean stream, and no crash where a library is missing."""

from __future__ import annotations

import gc
import warnings
from pathlib import Path

import pytest

from benchmarks import peers
from benchmarks.measuring import Comparison
from benchmarks.peers import tables
from benchmarks.peers.damage import DAMAGES, damage, recall
from benchmarks.peers.ours import Ours, OursTyped, Textbook, typical
from benchmarks.peers.peer import SIZES, Peer
from benchmarks.peers.row import Row
from benchmarks.peers.speed import Pace, Speed


def installed() -> list[type[Peer]]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # theirs
        others, _ = peers.installed()
    return [Ours, OursTyped, *others]


def test_what_is_missing_is_reported_and_the_rest_is_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(peers, "PEERS", {"nothing-like-it": ("no_such_module", ("Nothing",))})
    monkeypatch.setattr(peers, "PACES", {True: Pace(1, 0.1, 1)})
    result = peers.run(short=True)
    gc.freeze()  # the benchmark has undone what conftest.py does
    assert result["missing"] == ["nothing-like-it"]
    assert result["wrong"] == []
    assert {row["parser"] for row in result["rows"]} == {"servolink", "textbook parser"}
    assert tables.MISSING in capsys.readouterr().out


def row(peer: type[Peer], times: float, typed: float) -> Row:
    speed = Speed(times, 1.0, Comparison(1.0, times, times, 0.01), Comparison(1.0, typed, typed, 0.01))
    return Row(peer, 14, 14, speed, {})


class Library(Textbook):
    package = "library"


class Builder(Library):
    name = "builder"
    builds = True


class Compiled(Library):
    name = "aioesphomeapi"
    validates = False


@pytest.mark.parametrize(("ratio", "met"), [(10.0, True), (9.94, False)])
def test_a_goal_is_missed_by_whoever_comes_nearest(ratio: float, met: bool) -> None:
    (goal,) = peers.goals([row(Library, 50.0, 1.0), row(Library, ratio, 1.0), row(Textbook, 2.0, 1.0)])
    assert goal["met"] == met
    assert goal["figure"] == f"{ratio:.1f}x its speed"


def test_ours_makes_objects_too_beside_a_parser_that_does() -> None:
    (goal,) = peers.goals([row(Library, 12.0, 1.0), row(Builder, 50.0, 9.0)])
    assert not goal["met"]
    assert goal["figure"] == "9.0x its speed"
    assert "builder, both with objects" in goal["name"]


def test_a_compiled_parser_has_a_goal_of_its_own() -> None:
    (goal,) = peers.goals([row(Compiled, 0.5, 0.1)])
    assert (goal["figure"], goal["met"]) == ("2.00x its time", False)


@pytest.mark.parametrize("size", SIZES)
def test_cobs_checks_the_same_sum_as_ours(size: int) -> None:
    cobs = pytest.importorskip("benchmarks.peers.stuffed", reason="in the extra bench").Cobs
    frame = cobs.frame(size, 7)
    assert len(cobs().feed(frame)) == 1
    assert cobs().feed(frame[:-3] + bytes([frame[-3] ^ 0x80 or 1]) + frame[-2:]) == []


def test_each_library_is_in_the_extra() -> None:
    declared = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    extra = declared.partition("\nbench = [")[2].partition("\n]")[0]
    assert [name for name in peers.PEERS if f'"{name}>=' not in extra] == []


@pytest.mark.parametrize("size", SIZES)
def test_each_parser_finds_every_frame_of_a_clean_stream(size: int) -> None:
    for peer in installed():
        sent = [frame for number in range(20) if (frame := peer.frame(size, number))]
        parser = peer()
        fed = [b"".join(sent)] if peer.feeding == "stream" else sent
        found = [parser.content(frame) for chunk in fed for frame in parser.feed(chunk)]
        assert len(found) == len(set(found)) == len(set(sent)), peer.name


@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_leaves_the_intact_frames_in_the_stream(kind: str) -> None:
    frames = [typical(14, number) for number in range(500)]
    damaged = damage(frames, 14, kind)
    rest = iter(damaged.pieces)
    assert all(frame in rest for frame in damaged.intact)
    assert (len(damaged.intact) < len(frames)) == DAMAGES[kind][1]
    assert (len(damaged.pieces) > len(frames)) == DAMAGES[kind][0]


def test_recall_counts_what_was_found_and_what_was_not_sent() -> None:
    frames = [typical(14, number) for number in range(10)]
    damaged = damage(frames, 14, "noise")
    complete = recall(Ours, damaged, damaged.pieces)
    assert (complete.intact, complete.found, complete.false, complete.share) == (10, 10, 0, 1.0)
    damaged.intact[:] = frames[:4]
    assert recall(Ours, damaged, damaged.pieces).false == 6
    damaged.intact[:] = [typical(14, number) for number in range(20)]
    assert recall(Textbook, damaged, frames).share == 0.5
