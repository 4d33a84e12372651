"""Verdict: facts, in words and numbers, that a conversation has shown about a board."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from servolink.doctor.learn_captions import encoding_finding
from servolink.doctor.spy.learning import Learner, Runs, Unknown
from servolink.recorder import Times

_MOST_SHOWN = 12
_START = {0: "stop", 1: "start"}
_HOLD = {0: "release", 1: "hold"}
_UNITS = {0: "degrees", 1: "raw ADC"}


class Fact(NamedTuple):
    """Fact learnt about the board."""

    name: str
    value: Any
    """For programs."""
    text: str
    """For people; not escaped."""


def verdict(learner: Learner) -> list[Fact]:
    """Return the facts, without kinds that never occurred."""
    return [fact for make in _FACTS for fact in make(learner)]


def _packets(learner: Learner) -> Iterator[Fact]:
    sent, received = (learner.orders[way].total() for way in ("sent", "received"))
    value = {"sent": sent, "received": received, "names": dict(learner.packets)}
    sizes = f"{learner.size['sent']:,} and {learner.size['received']:,} bytes"
    yield Fact("packets", value, f"{sent:,} from the program, {received:,} from the board; {sizes}")


def _byte_order(learner: Learner) -> Iterator[Fact]:
    board, program = learner.orders["received"], learner.orders["sent"]
    if not board:
        tried = " and ".join(f"{count} requests in {order}-endian" for order, count in program.items())
        text = f"unknown: the board sent no packet; {tried or 'the program neither'}"
        yield Fact("byte_order", None, text)
        return
    order = learner.byte_order
    text = f"{order}: so are {_share(board[order] if order else 0, board.total())} of the board's packets"
    if others := {each: count for each, count in program.items() if each != order}:
        text += "; the program also tried " + " and ".join(f"{each}, {count} times" for each, count in others.items())
    yield Fact("byte_order", order, text)


def _transmission_mode(learner: Learner) -> Iterator[Fact]:
    modes, answered = learner.modes, learner.orders["received"].total() - learner.mode_echoes
    first: int | None = None
    if not modes:
        if not answered:
            return
        first, text = 1, "1 already: the board answered, and no mode was set"
    else:
        wanted, asked_before, answered_before = modes[0]
        said = f"the program set {_list((str(mode.wanted) for mode in modes), count=learner.mode_settings)}"
        said += ", the board said "
        said += _list(map(str, learner.echoes), count=learner.mode_echoes) or "nothing"
        if answered_before:
            first, text = 1, f"1 already: the board answered before any mode was set; {said}"
        elif asked_before and wanted == 1 and answered:
            first, text = 0, f"0 at first: {_count(asked_before, 'request')} without an answer before; {said}"
        else:
            text = f"unknown at first: {said} before anything else was answered"
    value = {"at_first": first, "set": [mode.wanted for mode in modes], "echoed": learner.echoes}
    yield Fact("transmission_mode", value, text)


def _caption_encoding(learner: Learner) -> Iterator[Fact]:
    if any(map(any, learner.captions)):
        found = encoding_finding(learner.captions)
        value = {"encoding": found.value, "confidence": found.confidence}
        yield Fact("caption_encoding", value, f"{found.value or 'unknown'}: {found.evidence}")


def _response_times(learner: Learner) -> Iterator[Fact]:
    if not learner.all_times.count:
        return
    value = {name: _times(times) for name, times in sorted(learner.times.items())}
    slowest = max(learner.times, key=lambda name: learner.times[name].longest)
    text = f"{_times_text(learner.all_times)}, the longest for {slowest}"
    yield Fact("response_time", {"all": _times(learner.all_times), "by_request": value}, text)


def _gaps(learner: Learner) -> Iterator[Fact]:
    if learner.gaps.count:
        text = f"{_times_text(learner.gaps)}, from a response to the next request"
        yield Fact("request_gap", _times(learner.gaps), text)
    if learner.most_under_way:
        many = learner.most_under_way > 1
        text = f"{learner.most_under_way} requests" if many else "1 request: the program waits for each response"
        yield Fact("under_way", learner.most_under_way, f"at most {text}")


def _orders(learner: Learner) -> Iterator[Fact]:
    for name, runs in (("import_order", learner.writes), ("export_order", learner.reads)):
        if runs.runs:
            yield Fact(name, runs.runs, _runs_text(runs))


def _ids(learner: Learner) -> Iterator[Fact]:
    for name, numbers in sorted(learner.ids.items()):
        yield Fact(f"{name}s", sorted(numbers), _list(map(str, sorted(numbers))))


def _settings(learner: Learner) -> Iterator[Fact]:
    if learner.memory_sizes:
        sizes = sorted(learner.memory_sizes)
        text = f"{_list(map(str, sizes))} bytes: {'with' if 8 in sizes else 'without'} the total size"
        yield Fact("memory_response", sizes, text)
    if learner.stops:
        texts = [
            f"{_START.get(start, start)} and {_HOLD.get(hold, hold)} {_servo(servo)} {_times_said(count)}"
            for (servo, start, hold), count in learner.stops.most_common(_MOST_SHOWN)
        ]
        value = [
            {"servo_id": key[0], "is_start": key[1], "is_hold": key[2], "count": n} for key, n in _top(learner.stops)
        ]
        yield Fact("stopping", value, ", ".join(texts))
    if learner.angle_units:
        texts = [f"{_UNITS.get(unit, unit)} for {_servo(servo)}" for servo, unit in learner.angle_units]
        value = [{"servo_id": key[0], "unit_type": key[1], "count": n} for key, n in _top(learner.angle_units)]
        yield Fact("angle_unit", value, _list(texts))


def _trouble(learner: Learner) -> Iterator[Fact]:
    for name, counts, meaning in (
        ("refused", learner.refused, "the board answered with the result 0"),
        ("unanswered", learner.unanswered, "no response came"),
        ("unsolicited", learner.unsolicited, "nobody had asked"),
        ("out_of_range", learner.out_of_range, "with values that the document does not allow"),
        ("undecodable", learner.undecodable, "intact, but the content contradicts itself"),
    ):
        if counts:
            yield Fact(name, dict(counts), f"{_counts_text(counts)}: {meaning}")
    if learner.unknown:
        value = [
            {**key._asdict(), "count": count, "content": first.hex()} for key, (count, first) in learner.unknown.items()
        ]
        yield Fact("unknown_packets", value, _unknown_text(learner.unknown))
    for way, who in (("sent", "program"), ("received", "board")):
        if learner.damaged[way]:
            yield Fact(f"damaged_{way}", learner.damaged[way], f"{_count(learner.damaged[way], 'frame')} of the {who}")
        if learner.noise[way]:
            first = learner.first_noise[way].hex()
            text = f"{_count(learner.noise[way], 'byte')} of the {who} in no frame, first {first}"
            yield Fact(f"noise_{way}", {"bytes": learner.noise[way], "first": first}, text)


_FACTS = (
    *(_packets, _byte_order, _transmission_mode, _caption_encoding, _response_times, _gaps),
    *(_settings, _orders, _ids, _trouble),
)


def _times(times: Times) -> dict[str, Any]:
    p50, p99 = times.percentile(50), times.percentile(99)
    return {"count": times.count, "p50": p50, "p99": p99, "longest": times.longest}


def _times_text(times: Times) -> str:
    p50, p99 = times.percentile(50) or 0.0, times.percentile(99) or 0.0
    return f"p50 {p50 * 1e3:.1f} ms, p99 {p99 * 1e3:.1f} ms, longest {times.longest * 1e3:.1f} ms"


def _runs_text(runs: Runs) -> str:
    texts = [name if count == 1 else f"{name} x{count}" for name, count in runs.runs]
    return _list(texts, 30) + (" and more" if runs.is_cut else "")


def _counts_text(counts: Mapping[str, int]) -> str:
    return _list(f"{name} {_times_said(count)}" for name, count in Counter(counts).most_common())


def _unknown_text(found: Mapping[Unknown, tuple[int, bytes]]) -> str:
    return _list(
        f"{key.packet_id} ({key.byte_order}) from the {'program' if key.direction == 'sent' else 'board'} "
        f"{_times_said(count)}, {_count(key.size, 'byte')} {first[:16].hex()}"
        for key, (count, first) in found.items()
    )


def _top(counts: Counter[Any]) -> list[tuple[Any, int]]:
    return counts.most_common(_MOST_SHOWN)


def _list(texts: Iterable[str], most: int = _MOST_SHOWN, *, count: int = 0) -> str:
    """Return the first texts, and the number of further texts; `count` is the number of all texts."""
    found = list(texts)
    rest = max(count, len(found)) - min(most, len(found))
    return ", ".join(found[:most]) + (f" and {rest} more" if rest > 0 else "")


def _servo(servo_id: int) -> str:
    return "all servos" if servo_id == 255 else f"servo {servo_id}"


def _times_said(count: int) -> str:
    return "once" if count == 1 else f"{count:,} times"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _share(some: int, of: int) -> str:
    return f"all {of:,}" if some == of else f"{some:,} of {of:,}"
