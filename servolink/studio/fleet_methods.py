"""Methods for the fleet of a studio: tiles of the boards, runs on several boards, and a stop of all."""

from __future__ import annotations

import asyncio
from typing import Annotated

from msgspec import Meta, Struct

from servolink.control import NoParams, Role, Runnable, Touches
from servolink.errors import NotFound
from servolink.fleet import MOST_BOARDS
from servolink.studio.fleet_view import FleetTiles, FleetView, RunnableName
from servolink.studio.studio_methods import METHODS, PageCaller

Boards = Annotated[list[Annotated[str, Meta(max_length=64)]], Meta(max_length=MOST_BOARDS)]


class FleetAsk(Struct, forbid_unknown_fields=True):
    """Revision of the latest answer; 0 for all tiles."""

    since: int = 0


class FleetGroups(Struct, frozen=True):
    """Names of boards by group, from the file `fleet.toml` on the machine of the studio."""

    groups: dict[str, tuple[str, ...]]


class FleetBoards(Struct, forbid_unknown_fields=True):
    """Names of boards."""

    boards: Boards


class FleetRunnable(Struct, frozen=True):
    """Actions and macros, those of most boards first."""

    runnable: tuple[RunnableName, ...]


class FleetRunAsk(Struct, forbid_unknown_fields=True):
    """Action or macro to run on boards."""

    run: Runnable
    boards: Boards
    anyway: bool = False
    """Whether to start the others if some boards cannot."""


class FleetRan(Struct, frozen=True):
    """Outcome of a run on several boards."""

    started: tuple[str, ...]
    held_back: tuple[str, ...]
    """Boards that were ready, and not started because others were not ready."""
    failed: dict[str, str]
    may_have_started: tuple[str, ...]
    """Boards in `failed` that may have started."""
    idle: tuple[str, ...]
    """Started boards with servos that are stopped or released, and do not move."""


class FleetStop(Struct, forbid_unknown_fields=True):
    """Boards to stop."""

    boards: Boards | None = None
    """All boards if null."""


class FleetStopped(Struct, frozen=True):
    """Answers of the boards to a stop."""

    stopped: tuple[str, ...]
    failed: dict[str, str]
    silent: tuple[str, ...]
    """Boards that were connected and did not answer: they may still move."""
    offline: tuple[str, ...]
    """Boards that no message can reach."""


@METHODS.add("studio.fleet", Role.WATCH, touches=Touches.NOTHING)
async def fleet_tiles(caller: PageCaller, params: FleetAsk) -> FleetTiles:
    """Return the boards that have changed since an earlier answer, as soon as one has."""
    return await _fleet_of(caller).changes(params.since)


@METHODS.add("studio.fleet.groups", Role.WATCH, touches=Touches.NOTHING)
async def fleet_groups(caller: PageCaller, params: NoParams) -> FleetGroups:
    """Return the groups of boards. Raise ServolinkError for a file that cannot be used."""
    fleet = _fleet_of(caller).fleet
    return FleetGroups(dict(await asyncio.to_thread(lambda: fleet.groups)))


@METHODS.add("studio.fleet.runnable", Role.EDIT, touches=Touches.HOST)
async def fleet_runnable(caller: PageCaller, params: FleetBoards) -> FleetRunnable:
    """Return what the boards have to run."""
    return FleetRunnable(_fleet_of(caller).runnable(params.boards))


@METHODS.add("studio.fleet.run", Role.EDIT, touches=Touches.HOST | Touches.MOTION)
async def fleet_run(caller: PageCaller, params: FleetRunAsk) -> FleetRan:
    """Start an action or a macro on several boards at the same moment, as `servolink fleet run` does.

    Each board checks the run and takes the lease first. If one cannot, nobody starts, unless `anyway`.
    """
    controller = _fleet_of(caller).fleet.controller
    from servolink.fleet import run_by_name  # with paho-mqtt, which a studio without a fleet may lack

    run, boards = params.run, dict.fromkeys(params.boards)
    ran = await run_by_name(controller, boards, run.id, run.type, anyway=params.anyway)
    return FleetRan(ran.started, ran.held_back, ran.failed, ran.may_have_started, tuple(ran.idle_servos))


@METHODS.add("studio.fleet.stop", Role.WATCH, touches=Touches.NOTHING, is_urgent=True)
async def fleet_stop(caller: PageCaller, params: FleetStop) -> FleetStopped:
    """Stop all servos of all boards, or of some, as `servolink fleet stop` does: every page may."""
    controller = _fleet_of(caller).fleet.controller
    from servolink.fleet import stop_all  # as above

    found = await stop_all(controller, params.boards)
    return FleetStopped(tuple(found.stopped), found.failed, found.silent, found.offline)


def _fleet_of(caller: PageCaller) -> FleetView:
    if isinstance(view := caller.studio.fleet, FleetView):
        return view
    raise NotFound("the studio has no fleet: start it with --fleet mqtt://HOST")
