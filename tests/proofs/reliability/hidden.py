"""Captions that hold a whole frame: what the parser makes of them when the line damages what is around them."""

from __future__ import annotations

from random import Random

from benchmarks.measuring import Result, table
from servolink.protocol import (
    CAPTION_SIZE,
    HEADER_SIZE,
    Codec,
    Frame,
    QueryActionListResponse,
    QueryProjectIDResponse,
    encode_frame,
)
from tests.proofs.reliability.framing import Listener, listen, short_answer
from tests.proofs.reliability.line import LINES

_HIDDEN = Codec().encode(QueryProjectIDResponse(0x7E11_0BAD))
_HIDDEN_FRAME: Frame = (QueryProjectIDResponse.packet_id, _HIDDEN[HEADER_SIZE:-1])
_HOSTILE = 0.3  # of the captions
_LISTS = 0.5  # of the frames
_LONGEST_LIST = 30


def _answer(random: Random) -> bytes:
    """Draw an answer, among them lists of actions with captions that no honest program writes."""
    if random.random() >= _LISTS:
        return short_answer(random)
    count = random.randint(1, _LONGEST_LIST)
    entries = (number.to_bytes(4, "little") + _caption(random, number) for number in range(1, count + 1))
    return encode_frame(QueryActionListResponse.packet_id, count.to_bytes(2, "little") + b"".join(entries), "little")


def _caption(random: Random, number: int) -> bytes:
    text = _HIDDEN if random.random() < _HOSTILE else f"action {number}".encode()
    return text.ljust(CAPTION_SIZE, b"\0")


def run(*, short: bool, seed: int = 1) -> Result:
    """Listen to 60,000 frames (short: 600) on each line, half of them lists with three hostile captions in ten."""
    frames = 600 if short else 60_000
    rows, figures, wrong = [], {}, []
    for line in LINES:
        if line.stalls and not line.damages:
            continue
        heard = _heard(listen(line, _answer, frames, f"hidden {seed} {line.name}"))
        figures[line.name] = heard
        rows.append((line.name, *(f"{number:,}" for number in heard.values())))
        if not line.damages and heard["came out"]:
            wrong.append(f"{line.name}: {heard['came out']} frames hidden in captions came out")
    quote = table(
        "frames hidden in captions",
        ("line", "damaged", "intact", "found", "came out of captions", "and got through"),
        rows,
        notes=[
            f"{frames:,} frames, half of them lists of which three captions in ten hold a whole frame",
            "`came out`: of the parser; `got through`: to a client, which drops what it finds in a frame that it knows",
        ],
    )
    return {"tables": [quote], "wrong": wrong, "figures": figures}


def _heard(listener: Listener) -> dict[str, int]:
    return {
        "damaged": listener.damaged,
        "intact": listener.sent.total(),
        "found": (listener.sent & listener.came).total(),
        "came out": listener.came[_HIDDEN_FRAME],
        "got through": listener.passed[_HIDDEN_FRAME],
    }
