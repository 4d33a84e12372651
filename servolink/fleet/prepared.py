"""PreparedRun: what a board begins when the message comes that starts all boards together."""

from __future__ import annotations

import asyncio

import msgspec
from msgspec import Raw, Struct

from servolink.errors import MotionRefused, NotFound
from servolink.fleet.hub_session import HubSession, result_of
from servolink.fleet.topics import Prepare, Prepared
from servolink.hub.control.messages import Done


class _Ran(Struct):
    """The part of the result of `run` that is of interest."""

    seconds: float | None = None


class PreparedRun:
    """At most one run, which the hub has checked and for which the board has the lease."""

    def __init__(self, hub: HubSession) -> None:
        """Use the board of `hub`."""
        self._hub = hub
        self._prepared: Prepare | None = None
        self._until = 0.0
        self._timer: asyncio.TimerHandle | None = None

    async def prepare(self, asked: Prepare) -> Prepared:
        """Have a run checked, and take the lease. Raise the error of the hub."""
        self.forget()
        checked = result_of(await self._hub.ask("run", {**_params(asked), "dry_run": True}))
        result_of(await self._hub.ask("lease.take", {}))
        loop = asyncio.get_running_loop()
        self._prepared, self._until = asked, loop.time() + asked.expires
        self._timer = loop.call_later(asked.expires, self.forget)
        return Prepared(msgspec.json.decode(checked, type=_Ran).seconds)

    def is_for(self, start: str) -> bool:
        """Return whether the message with this id starts what is prepared."""
        return self._prepared is not None and self._prepared.start == start

    async def start(self) -> Raw:
        """Begin what is prepared, once. Raise MotionRefused if that is too late, or the error of the hub."""
        prepared, until = self._prepared, self._until
        self._drop()
        if prepared is None or asyncio.get_running_loop().time() > until:
            raise MotionRefused("what was prepared has expired; nothing was moved")
        return result_of(await self._hub.ask("run", {**_params(prepared), "wait": False}))

    def cancel(self, start: str) -> Done:
        """Forget what is prepared for this start. Raise NotFound if nothing is."""
        if not self.is_for(start):
            raise NotFound(f"nothing is prepared for {start}")
        self.forget()
        return Done()

    def forget(self) -> None:
        """Forget what is prepared, and give the lease back."""
        if self._prepared is not None:
            self._drop()
            self._hub.tell("lease.give")

    def _drop(self) -> None:
        self._prepared = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _params(prepared: Prepare) -> dict[str, object]:
    return {"type": prepared.run.type, "id": prepared.run.id}
