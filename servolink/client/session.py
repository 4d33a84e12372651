"""Checks of what a program gives: a wrong value is told at once, not by what comes of it later."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Literal, TypeVar

from servolink.connection.connection import Connection
from servolink.connection.explain import described
from servolink.errors import EncodeError, NotFound, Rejected, RequestTimeout, ServolinkError
from servolink.escaping import escape, quote
from servolink.motion import is_number
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.packet import Command, Request, Response, Result
from servolink.protocol.servos import ExecuteActionRequest

_LONGEST_TIMEOUT = 3600  # a cancelled request keeps its turn so long, and a stop is read back only then
_MOST = 1_000


def check_timeout(value: object) -> None:
    """Raise TypeError or ValueError if `value` is no time for an answer: 0.001..3600 seconds."""
    if not is_number(value):
        raise TypeError(f"timeout: {quote(value)} is no number of seconds")
    if not 0.001 <= value <= _LONGEST_TIMEOUT:
        raise ValueError(f"timeout: {quote(value)} is outside 0.001..{_LONGEST_TIMEOUT} seconds")


def check_count(name: str, value: object, least: int) -> None:
    """Raise TypeError or ValueError if `value` is no whole number `least`..1000."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{name}: {quote(value)} is no whole number")
    if not least <= value <= _MOST:
        raise ValueError(f"{name}: {quote(value)} is outside {least}..{_MOST}")


_NOT_DONE = (EncodeError, Rejected, RequestTimeout)
"""After these the board is as it was: nothing was sent, or the board says so."""


class Identity:
    """The project ids that the board may have; with none, which is before it was asked, no board is it."""

    def __init__(self) -> None:
        """Know nothing yet."""
        self._project_ids: frozenset[int] = frozenset()
        self.changes = 0
        """How often it has become another one."""

    def know(self, project_id: int) -> None:
        """Take note of what the board has for certain."""
        self._project_ids = frozenset({project_id})
        self.changes += 1

    def may_have(self, project_id: int) -> None:
        """Reckon with `project_id` besides what the board had."""
        self._project_ids |= {project_id}
        self.changes += 1

    def hear(self, project_id: int, since: int) -> None:
        """Take note of an answer to what was asked when there had been `since` changes."""
        if self.changes == since:
            self.know(project_id)
        else:  # another id was written or given up meanwhile, and may be what the board has now
            self.may_have(project_id)

    @contextmanager
    def changing(self, link: Connection, project_id: int) -> Iterator[None]:
        """Reckon with `project_id` too, if what is asked of `link` meanwhile fails and may yet have been done."""
        was_lost = link.answers.ended is not None
        try:
            yield
        except _NOT_DONE:
            raise
        except BaseException:  # cancelled, for one: it may be on its way
            if not was_lost:
                self.may_have(project_id)
            raise

    async def check(self, link: Connection) -> None:
        """Ask which board a new link leads to, and know it from then on; NotFound if it is another."""
        request = QueryProjectIDRequest()
        found = (await link.request(request)).project_id
        if found not in self._project_ids:
            known = " or ".join(str(project_id) for project_id in sorted(self._project_ids))
            raise NotFound(f"the board there has project id {found}, not {known}", request)
        self.know(found)


R = TypeVar("R", bound=Response)


class Chapter:
    """Commands to one board."""

    def __init__(self, link: Connection) -> None:
        """Speak through `link`."""
        self._link = link
        self._identity = Identity()

    @property
    def url(self) -> str:
        """The address of the board."""
        return self._link.transport.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of this connection."""
        return self._link.codec

    @property
    def connection(self) -> object:
        """What stands for the connection: another object once it was lost and has come back."""
        return self._link

    async def request(
        self, packet: Request[R], *, timeout: float | None = None, retries: int | None = None, unchecked: bool = False
    ) -> R:
        """Send any packet that is answered and return its answer, whatever that says.

        `unchecked` gives back to a board what was read from one: captions may then hold control characters, numbers all
        that the wire carries.

        Raises EncodeError before anything is sent; RequestTimeout after the retries of a query; OutcomeUnknown
        when a command that changes something was sent and not answered; ConnectionLost.
        """
        if not isinstance(packet, Request):
            raise TypeError(f"{type(packet).__name__} is never answered; use send")
        if timeout is not None:
            check_timeout(timeout)
        if retries is not None:
            check_count("retries", retries, 0)
        return await self._link.request(packet, timeout=timeout, retries=retries, unchecked=unchecked)

    async def send(self, packet: Command) -> None:
        """Send any packet that is never answered; EncodeError also for the same servo twice in one movement."""
        if not isinstance(packet, Command):
            raise TypeError(f"{type(packet).__name__} is answered; use request")
        if isinstance(packet, ExecuteActionRequest):
            servo_ids = [step.servo_id for step in packet.steps]
            if twice := {servo_id for servo_id in servo_ids if servo_ids.count(servo_id) > 1}:
                raise EncodeError(f"ExecuteActionRequest.steps: servo {min(twice)} is in it twice")
        await self._link.send(packet)

    async def _do(self, packet: Request[Result], reasons: str) -> None:
        """Send a command and raise Rejected, with the likely `reasons`, if the board says it failed."""
        if not (await self._link.request(packet)).result:
            raise Rejected(f"{escape(self.url)} refused {described(packet)}: {reasons}", packet)


_logger = logging.getLogger(__name__)

ConnectionState = Literal["connected", "lost", "closed"]

FIRST_PAUSE = 0.1
"""Seconds from the loss of a connection to the first try; each further pause is twice as long."""
LONGEST_PAUSE = 5.0


class States:
    """The state of a connection, for any number of readers."""

    def __init__(self) -> None:
        """Begin connected."""
        self.now: ConnectionState = "connected"
        self._readers: list[asyncio.Queue[ConnectionState]] = []

    def become(self, state: ConnectionState) -> None:
        """Tell every reader of a change; nothing comes after `closed`."""
        if self.now not in {state, "closed"}:
            self.now = state
            for reader in self._readers:
                reader.put_nowait(state)

    async def read(self) -> AsyncIterator[ConnectionState]:
        """Yield the state as it is and then each change, up to `closed`."""
        reader: asyncio.Queue[ConnectionState] = asyncio.Queue()
        reader.put_nowait(self.now)
        self._readers.append(reader)
        try:
            state: ConnectionState | None = None
            while state != "closed":
                state = await reader.get()
                yield state
        finally:
            self._readers.remove(reader)


class Reconnector:
    """Brings a board back whenever its link is lost."""

    def __init__(
        self, open_link: Callable[[], Awaitable[Connection]], resume: Callable[[Connection], Awaitable[None]]
    ) -> None:
        """`open_link` opens a new link to the same board; `resume` restores the session on it and uses it."""
        self._open_link = open_link
        self._resume = resume
        self._task: asyncio.Task[None] | None = None
        self._stopped = False

    def start(self) -> bool:
        """Begin to reconnect, unless that is under way; tell whether it is, which it is not after `stop`."""
        if not self._stopped and (self._task is None or self._task.done()):
            self._task = asyncio.get_running_loop().create_task(self._until_connected())
        return not self._stopped

    async def stop(self) -> None:
        """Give up for good."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait((self._task,))

    async def _until_connected(self) -> None:
        pause = FIRST_PAUSE
        while True:
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)
            try:
                await self._resume_on(await self._open_link())
            except ServolinkError:
                pass  # not there yet, not to be opened yet, or another one
            except Exception:
                _logger.exception("a try to reconnect failed in a way that is none of ours; the next is in %g s", pause)
            else:
                return

    async def _resume_on(self, link: Connection) -> None:
        try:
            await self._resume(link)
        except BaseException:
            await link.close()
            raise
