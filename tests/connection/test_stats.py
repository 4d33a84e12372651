"""Stats: counters with names that stay."""

from __future__ import annotations

from servolink.connection.explain import timed_out
from servolink.connection.stats import Stats
from servolink.protocol import QueryServoListRequest


def test_a_round_trip_percentile_is_the_time_within_which_so_many_came() -> None:
    stats = Stats()
    assert stats.round_trip(50) is None
    stats.round_trips.extend(number / 1000 for number in range(100, 0, -1))
    assert [stats.round_trip(percent) for percent in (0, 50, 99, 100)] == [0.001, 0.051, 0.1, 0.1]


def test_only_the_latest_round_trips_are_kept() -> None:
    stats = Stats()
    stats.round_trips.extend([9.0] * 10_000 + [1.0] * 4096)
    assert stats.round_trip(100) == 1.0


def test_what_fills_the_reports_of_a_hid_board_is_not_noise() -> None:
    stats = Stats()
    stats.skipped.update(padding=649, noise=3, checksum=4)
    assert stats.noise == 7
    stats.skipped.update(noise=0, checksum=0)
    text = str(timed_out(QueryServoListRequest(), "hid://", 3, 1.0, stats, answers_others=True))
    assert text.endswith("the board answers other requests, so it may not know this one or what it asks about")


def test_as_dict_has_plain_numbers_under_names_that_programs_rely_on() -> None:
    stats = Stats()
    stats.skipped.update(noise=3)
    stats.round_trips.append(0.0123456)
    plain = stats.as_dict()
    assert plain["skipped"] == {"noise": 3}
    assert plain["round_trip_ms"] == {"p50": 12.346, "p90": 12.346, "p99": 12.346}
    assert Stats().as_dict()["round_trip_ms"] == {"p50": None, "p90": None, "p99": None}
    assert {
        "bytes_sent",
        "bytes_received",
        "frames_sent",
        "frames_received",
        "undecodable",
        "unsolicited",
        "mismatched",
        "late_responses",
        "reopenings",
        "timeouts",
        "retries",
        "fences",
        "events_received",
        "events_dropped",
        "skipped",
        "round_trip_ms",
    } <= set(plain)
    assert all(type(value) is int for name, value in plain.items() if name not in {"skipped", "round_trip_ms"})


def test_printing_stats_shows_what_happened_and_a_summary_of_the_round_trips() -> None:
    stats = Stats()
    stats.frames_sent, stats.timeouts = 200, 1
    stats.skipped.update(noise=3)
    stats.round_trips.extend(number / 1000 for number in range(1, 201))
    assert (
        str(stats)
        == repr(stats)
        == (
            "Stats(frames_sent=200, timeouts=1, skipped={'noise': 3}, "
            "round_trips=<200, median 101 ms, 95 % within 191 ms>)"
        )
    )
    assert str(Stats()) == "Stats()"
