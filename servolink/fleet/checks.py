"""Checks of a fleet: broker, network, and boards."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator

from msgspec import Struct

from servolink.errors import ServolinkError
from servolink.fleet.controller import Controller, new_id
from servolink.fleet.each import for_each
from servolink.fleet.roster import BoardSeen

_PATIENCE = 3.0  # seconds for the messages of the check
_AT_ONCE = 64  # boards asked together
_SLOW = 0.25
"""Seconds of a round trip above which manual control feels late."""
_SKEW = 5.0
"""Seconds by which clocks may differ; commands expire by the broker's clock only, but logs are compared."""


class Check(Struct, frozen=True):
    """Problem of a fleet, with a remedy."""

    about: str
    """The name of a board, or `broker`, or `fleet`."""
    observation: str
    remedy: str


async def examine_fleet(controller: Controller) -> tuple[Check, ...]:
    """Ask the broker and every board. Nothing is moved or changed."""
    await controller.settle()
    found = [*_of_the_fleet(controller)]
    online = controller.roster.online
    patience = min(_PATIENCE, controller.patience)
    delays = await _round_trips(controller, patience)
    outcomes = await for_each(
        online, lambda board: controller.call(board, "board.state", patience=patience), parallel=max(1, len(online))
    )
    for seen in controller.roster:
        found += _of_state(seen)
        if (error := outcomes.failed.get(seen.name)) is not None:
            found.append(_silent(seen, error))
        elif seen.name in delays and delays[seen.name] > _SLOW:
            text = f"a round trip takes {delays[seen.name] * 1000:.0f} ms"
            found.append(Check(seen.name, text, "use a cable or a better wireless network; a stop takes as long"))
    return tuple(found)


async def _round_trips(controller: Controller, patience: float) -> dict[str, float]:
    """Return the seconds of a message to each board and back."""
    loop, message_id, online = asyncio.get_running_loop(), new_id(), controller.roster.online
    sent: dict[str, float] = {}

    async def echo(board: str) -> None:
        sent[board] = loop.time()
        await controller.echo(controller.topics.board(board, "echo"), message_id, expires=patience)

    with controller.pending_command(message_id) as pending:
        await for_each(online, echo, parallel=_AT_ONCE)
        await pending.until(online, loop.time() + patience)
        return {board: came - sent[board] for board, came in pending.seconds.items() if board in sent}


def _of_the_fleet(controller: Controller) -> Iterator[Check]:
    if not len(controller.roster):
        text = f"no board has ever joined under the prefix {controller.topics.prefix!r}"
        yield Check("fleet", text, "run `servolink fleet join` on the machine of a board, with the same --prefix")
    if controller.roster.refused:
        text = f"{controller.roster.refused} messages were too long, or of boards beyond the first 5,000"
        yield Check("fleet", text, "find the other writer at the broker, and allow only known users in the access list")
    versions = {seen.now.version for seen in controller.roster if seen.is_online and seen.now is not None}
    if len(versions) > 1:
        text = f"boards are joined by different versions of servolink: {', '.join(sorted(versions))}"
        yield Check("fleet", text, "install the same version everywhere")


def _of_state(seen: BoardSeen) -> Iterator[Check]:
    if seen.problem:
        yield Check(
            seen.name, seen.problem, "install the same version of servolink everywhere; or see who writes there"
        )
    if not seen.is_online:
        yield Check(
            seen.name,
            "is not connected with the broker",
            "start `servolink fleet join` on its machine, or look at its network",
        )
        return
    if seen.now is None:
        yield Check(seen.name, "has not published its state", "restart `servolink fleet join` on its machine")
        return
    if seen.now.connection != "connected":
        text = f"the connection of {seen.now.host} to the board is {seen.now.connection}"
        yield Check(
            seen.name, text, f"check cable and power of the board; `servolink doctor` on {seen.now.host} finds more"
        )
    for problem in seen.now.problems:
        yield Check(seen.name, problem, f"look at the board on {seen.now.host}")
    ahead = seen.now.at - time.time()
    if ahead > _SKEW:
        text = f"the clock of {seen.now.host} is {ahead:.0f} s ahead of this machine's"
        yield Check(seen.name, text, "set both by the network (NTP)")


def _silent(seen: BoardSeen, error: ServolinkError) -> Check:
    return Check(
        seen.name,
        f"does not answer: {error}",
        "check the load of the machine, and the topics of the board in the access list of the broker",
    )
