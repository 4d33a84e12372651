"""Boards of this machine at a broker: find or begin the hub of each board, and bridge the hub."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any, NamedTuple, NoReturn, TypeAlias

from servolink.boards import NO_BOARD_FOUND, Aliases, boards, resolve_board, search
from servolink.control import decode
from servolink.errors import OpenError, ServolinkError
from servolink.fleet.access import BrokerAccess
from servolink.fleet.bridge import Bridge
from servolink.fleet.broker import retained
from servolink.fleet.command_log import opened_command_log
from servolink.fleet.commands import Level
from servolink.fleet.home_assistant import HomeAssistant
from servolink.fleet.policy import FleetFile, PolicyFile
from servolink.fleet.pulse import INTERVAL, SLACK
from servolink.fleet.topics import ONLINE, UNREADABLE, BoardNow, Topics
from servolink.fleet.urgent import Urgent
from servolink.hub import serve_board
from servolink.support import is_name

OnLine: TypeAlias = Callable[[Level, str], None]

_SHARED = "share://"
_LOOK = 1.0  # seconds between looks at the policy file
_FAREWELL = 1.0  # seconds for the last answers


class LocalBoard(NamedTuple):
    """Board of this machine, ready for a bridge."""

    hub: str
    """Name of the hub that shares the board."""
    name: str
    """Name of the board in the fleet."""


@asynccontextmanager
async def local_boards(
    names: Sequence[str], name: str | None = None, **options: Any
) -> AsyncIterator[list[LocalBoard]]:
    """Yield the boards with these names or addresses, or all of this machine; share boards that no hub shares.

    A hub that begins has the name of its board, if the board has one.
    `name` is what the fleet calls the only one, in place of the name of its hub, and the name of a hub that begins
    for a board that was given by its address. `options` are those of `connect`. Raise OpenError if there is none,
    or one cannot be used.
    """
    addresses = await _named(names) if names else await _found()
    if name is not None and len(addresses) != 1:
        raise OpenError(
            f"--name is for one board, and {len(addresses)} are to join: name one of {', '.join(addresses)}"
        )
    async with AsyncExitStack() as stack:
        found = []
        for address, given in addresses.items():
            if address.startswith(_SHARED):
                hub = address.removeprefix(_SHARED).partition("?")[0]
            else:  # the hub keeps the name given by the user, if the user gave a name
                hub_name = None if is_name(given) else name
                hub = (await stack.enter_async_context(serve_board(given, name=hub_name, **options)))[0].name
            found.append(LocalBoard(hub, name or hub))
        yield found


async def _named(names: Sequence[str]) -> dict[str, str]:
    """Return the names by their addresses."""
    return {(await resolve_board(name)).url: name for name in names}


async def _found() -> dict[str, str]:
    found = boards(await asyncio.to_thread(search))
    usable = [board.url for board in found if not board.problem]
    if not usable:
        problems = "; ".join(f"{board.url}: {board.problem}" for board in found)
        raise OpenError(problems or NO_BOARD_FOUND)
    names = Aliases.load().by_url(found)
    return {url: names.get(url, url) for url in usable}


class LocalFleet:
    """Boards of this machine that take part in a fleet."""

    def __init__(
        self,
        access: BrokerAccess,
        topics: Topics,
        policies: FleetFile,
        *,
        hz: float,
        home_assistant: HomeAssistant | None = None,
    ) -> None:
        """Take part at a broker, as `policies` allow; use `join`.

        The servos are sent `hz` times a second at most. Home Assistant finds the boards if `home_assistant` says where.
        """
        self.bridges: list[Bridge] = []
        self.on_line: OnLine = lambda level, text: None
        """Called with notices for people at this machine, not escaped."""
        self._access = access
        self._topics = topics
        self._policies = policies
        self._hz = hz
        self._home_assistant = home_assistant
        self._was_lost = False

    async def join(self, members: Sequence[LocalBoard], on_ready: Callable[[], None]) -> None:
        """Serve boards until cancelled; call `on_ready` when all have joined. OpenError if a board cannot join."""
        async with AsyncExitStack() as stack:
            command_logs = [stack.enter_context(opened_command_log(board.name)) for board in members]
            kept = await retained(self._access, [*self._kept_topics(members)])
            await self._check(members, kept)
            for board, command_log in zip(members, command_logs, strict=True):
                policy = self._policies.policy_of(board.name)
                bridge = Bridge(board.hub, board.name, self._access, self._topics, policy, command_log, hz=self._hz)
                bridge.telemetry.on_line = partial(self._tell, f"{board.name}: ")
                if self._home_assistant is not None:
                    bridge.announce(self._home_assistant, kept)
                self.bridges.append(bridge)
            urgent = Urgent(self._access, self._topics, self.bridges)
            urgent.broker.on_state = self._tell_state
            urgent.broker.on_problem = partial(self._tell, "", "error")
            await _serve(self.bridges, urgent, on_ready)

    async def follow(self, file: PolicyFile) -> NoReturn:
        """Allow what the file allows after each of its changes, in an endless loop."""
        while True:
            await asyncio.sleep(_LOOK)
            try:
                has_changed = file.read_again()
            except ServolinkError as error:
                self._tell("", "error", f"{error}; until then, the earlier policy applies")
                continue
            if has_changed:
                self._policies = file.policies
                for bridge in self.bridges:
                    bridge.follow(file.policies.policy_of(bridge.board))

    def _tell(self, board: str, level: Level, text: str) -> None:
        self.on_line(level, f"{board}{text}")

    def _tell_state(self, is_connected: bool, text: str) -> None:  # noqa: FBT001 - the only argument of its kind
        if is_connected and self._was_lost:
            self.on_line("info", f"{self._access.address}: connected again")
        elif not is_connected and not self._was_lost:
            self.on_line("error", f"{text}; trying again")
        self._was_lost = not is_connected

    def _kept_topics(self, members: Sequence[LocalBoard]) -> Iterator[str]:
        for _, name in members:
            yield self._topics.board(name, "available")
            yield self._topics.board(name, "state")
            yield self._topics.board(name, "pulse")
            if self._home_assistant is not None:
                yield self._home_assistant.topic(self._topics, name)
                yield self._home_assistant.earlier_topic(self._topics, name)

    async def _check(self, members: Sequence[LocalBoard], kept: Mapping[str, bytes]) -> None:
        """Raise OpenError for a board whose name is in use by another machine's board."""
        pulses = []
        for _, name in members:
            if kept.get(self._topics.board(name, "available")) != ONLINE.encode():
                continue
            try:
                state = decode(kept.get(self._topics.board(name, "state"), b""), BoardNow)
            except UNREADABLE:
                continue
            if state.host != socket.gethostname():
                raise _taken(name, state.host)
            pulses.append(self._topics.board(name, "pulse"))
        if not pulses:
            return
        # Either a bridge of this machine that was killed and not yet missed, or another machine of the same name.
        await asyncio.sleep(INTERVAL + SLACK)
        for topic, word in (await retained(self._access, pulses)).items():
            if word != kept.get(topic):
                raise _taken((self._topics.parse(topic) or ("",))[0], f"another machine called {socket.gethostname()}")


def _taken(name: str, where: str) -> OpenError:
    return OpenError(
        f"a board called {name} has joined already, from {where}: give this one another name, with --name or with "
        "`servolink use NAME BOARD`"
    )


async def _serve(bridges: Sequence[Bridge], urgent: Urgent, on_ready: Callable[[], None]) -> None:
    tasks = [asyncio.create_task(_run(bridges, urgent)), asyncio.create_task(_ready(bridges, urgent))]
    running, ready = tasks
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if not running.done():
            on_ready()
        await running
    finally:
        ready.cancel()
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


async def _ready(bridges: Sequence[Bridge], urgent: Urgent) -> None:
    for broker in [urgent.broker, *(bridge.broker for bridge in bridges)]:
        await broker.until_connected()


async def _run(bridges: Sequence[Bridge], urgent: Urgent) -> None:
    """Run all tasks. Raise the first error of any task."""
    try:
        async with asyncio.TaskGroup() as group:
            urgent.begin(group)
            for bridge in bridges:
                bridge.start(group)
            try:
                await asyncio.Event().wait()
            finally:
                async with asyncio.timeout(_FAREWELL):
                    await asyncio.gather(urgent.leave(), *(bridge.leave() for bridge in bridges))
    except* ServolinkError as errors:
        raise _first(errors) from None
    except* TimeoutError:
        pass


def _first(errors: BaseExceptionGroup[Any]) -> BaseException:
    first: BaseException = errors
    while isinstance(first, BaseExceptionGroup):
        first = first.exceptions[0]
    return first
