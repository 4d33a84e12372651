"""From the devices that were found to the boards that they are, and to the one that is meant."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from servolink.errors import OpenError
from servolink.printable import printable
from servolink.transports.candidate import Candidate

NONE_HERE = (
    "no board was found; plug it in and switch it on, or name one (with --url or SERVOLINK_URL in a shell), as in "
    "serial:///dev/ttyACM0, tcp://192.168.1.20:9000 or virtual://; `servolink doctor` looks for the reason"
)


def boards(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return one candidate for each board: the first that can be opened, or else the first.

    What has the same serial number is one board that is reached in several ways, unless two are reached in the
    same way: makers of cheap adapters give all of them the same number.
    """
    groups: dict[object, list[Candidate]] = {}
    candidates = list(candidates)
    shared = _shared_numbers(candidates)
    for candidate in candidates:
        number = candidate.serial_number
        groups.setdefault(candidate if not number or number in shared else number, []).append(candidate)
    return [next((way for way in ways if not way.problem), ways[0]) for ways in groups.values()]


def only(candidates: Sequence[Candidate]) -> str:
    """Return the address of the only board, or of the only one that can be opened; OpenError names them all."""
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if len(usable) == 1:
        return usable[0].url
    if not found:
        raise OpenError(NONE_HERE)
    if len(found) == 1:
        raise OpenError(f"{printable(found[0].url)}: {printable(found[0].problem)}")
    raise OpenError(f"{len(found)} boards are here; name one of {', '.join(printable(board.url) for board in found)}")


def scheme(candidate: Candidate) -> str:
    """Return how `candidate` is reached."""
    return candidate.url.partition("://")[0]


def _shared_numbers(candidates: Iterable[Candidate]) -> set[str]:
    uses = Counter((scheme(candidate), candidate.serial_number) for candidate in candidates)
    return {number for (_, number), count in uses.items() if count > 1}
