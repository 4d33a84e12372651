"""HubSession: session of the bridge with the hub of a board, renewed after the hub has ended."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import msgspec
from msgspec import Raw

from servolink.control import ErrorObject, Greeting, ProblemNotice, Reply, RpcChannel, open_channel
from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.fleet.policy import FILE, BoardPolicy
from servolink.support import Pauses, Reconnecting

_UNTIL = "until its hub is begun with `servolink share --forecast FIGURE`"


class HubSession:
    """A program of a hub, with the rights and the limits of a policy: the hub enforces both."""

    def __init__(self, name: str, policy: BoardPolicy, who: str) -> None:
        """Use the board shared as `name`, as `who`; use `run`."""
        self.name = name
        self.on_notification: Callable[[str, Raw], None] = lambda name, params: None
        self.on_connect: Callable[[], Awaitable[None]] | None = None
        """Awaited on each connection."""
        self.on_lost: Callable[[str], None] = lambda text: None
        """Called with the reason when the hub is gone."""
        self.has_begun = asyncio.Event()
        """Set on the first connection."""
        self._policy = policy
        self._greeting = Greeting(wants="rpc", who=who, role=policy.allow)
        self._channel: RpcChannel | None = None
        self._was_connected = False

    @property
    def is_connected(self) -> bool:
        """Whether the hub is there."""
        return self._channel is not None

    def follow(self, policy: BoardPolicy) -> None:
        """Begin a new session, with the rights and the limits of `policy`."""
        self._policy = policy
        self._greeting = msgspec.structs.replace(self._greeting, role=policy.allow)
        if self._channel is not None:
            self._channel.abort()

    async def run(self) -> None:
        """Connect, and again after each loss. Raise OpenError if the first attempt fails."""
        pauses = Pauses()
        async for channel in Reconnecting(self._open, pauses, self._may_come_back):
            self._was_connected = True
            policy = self._policy
            pauses.restart()
            try:
                await channel.until_ended()
            finally:
                self._channel = None
                await channel.close()
            if policy is self._policy:
                self.on_lost(f"the hub of {self.name} has ended; waiting for it")

    async def ask(self, method: str, params: object, on_progress: Callable[[Raw], None] | None = None) -> Reply:
        """Return the result of a method of the hub. Raise ConnectionLost without a hub."""
        if self._channel is None:
            raise ConnectionLost(f"the hub of {self.name} is not running; reconnecting")
        return await self._channel.ask(method, params, on_progress)

    def tell(self, method: str, **params: object) -> None:
        """Call a method without waiting for the response; no effect without a hub."""
        if self._channel is not None:
            self._channel.tell(method, **params)

    async def _open(self) -> RpcChannel:
        policy = self._policy
        channel, welcome = await open_channel(self.name, self._greeting)
        if policy.forecast and policy.allow != "watch" and not welcome.has_forecast:
            await channel.close()
            # Fewer rights in place of an error: a stop from afar must get through.
            channel, _ = await open_channel(self.name, msgspec.structs.replace(self._greeting, role="watch"))
            problem = ProblemNotice(f"{FILE} asks for a forecast: others may only watch and stop {self.name} {_UNTIL}")
            self.on_notification("problem", Raw(msgspec.json.encode(problem)))
        channel.on_notification = self.on_notification
        try:
            await self._begin(channel, policy)
        except BaseException:
            self._channel = None
            await channel.close()
            raise
        return channel

    async def _begin(self, channel: RpcChannel, policy: BoardPolicy) -> None:
        if (limits := policy.tightening()) is not None:
            reply = await channel.ask("limits.tighten", limits)
            if (fault := reply.fault) is not None:  # without the limits of the policy, no motion is allowed
                raise ServolinkError(f"the limits for {self.name} cannot be used: {fault.message}")
        if policy is not self._policy:
            raise ConnectionLost("the policy has changed meanwhile")
        self._channel = channel
        self.has_begun.set()
        if self.on_connect is not None:
            await self.on_connect()

    def _may_come_back(self, error: Exception) -> bool:
        return self._was_connected and isinstance(error, (OpenError, ConnectionLost))


class HubError(ServolinkError):
    """Error of the hub, passed on unchanged."""

    def __init__(self, told: ErrorObject) -> None:
        super().__init__(told.message)
        self.told = told


def result_of(reply: Reply) -> Raw:
    """Return the result in a reply. Raise HubError for a reply with an error."""
    if (fault := reply.fault) is not None:
        raise HubError(fault)
    return reply.result
