"""A program on the control interface of a hub, for tests: messages in and out, without a socket."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from servolink.client import connect
from servolink.control import Greeting, RoleName
from servolink.hub.hub import Hub, share
from servolink.hub.methods.control_session import ControlInterface, ControlSession
from servolink.protocol import ALL_SERVOS, QueryServoRequest, ServoState
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport


class RpcFailed(Exception):
    """A request was answered with an error."""

    def __init__(self, error: dict[str, Any]) -> None:
        super().__init__(error["message"])
        self.code: int = error["code"]
        self.kind: str = error["data"]["kind"]
        self.remedy: str = error["data"]["remedy"]
        self.path: str = error["data"]["path"]


class RpcProgram:
    """One program."""

    def __init__(self, hub: Hub, interface: ControlInterface, greeting: Greeting) -> None:
        self.heard: list[tuple[str, dict[str, Any]]] = []
        """All notifications."""
        self.aborted = ""
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._changed = asyncio.Event()
        session_id = greeting.session or f"session of {greeting.who}"
        self.channel: ControlSession = interface.open_channel(hub, greeting, session_id, self._take, self._abort)

    def _abort(self, reason: str) -> None:
        self.aborted = reason

    def _take(self, message: bytes) -> None:
        value = json.loads(message)
        if "method" in value:
            self.heard.append((value["method"], value["params"]))
        elif "error" in value:
            self._answers.pop(value["id"]).set_exception(RpcFailed(value["error"]))
        else:
            self._answers.pop(value["id"]).set_result(value["result"])
        self._changed.set()

    def begin(self, method: str, **params: Any) -> asyncio.Future[Any]:
        """Send a request, and return the future of its result."""
        request_id = len(self._answers) + 1000 * len(self.heard) + id(params)
        self._answers[request_id] = asyncio.get_running_loop().create_future()
        answer = self._answers[request_id]
        message = {"jsonrpc": "2.0", "id": request_id, "method": method, "params": params}
        self.channel.receive(json.dumps(message))
        return answer

    async def call(self, method: str, **params: Any) -> Any:
        """Return the result of a request. Raise RpcFailed for an error."""
        return await self.begin(method, **params)

    def tell(self, method: str, **params: Any) -> None:
        """Send a request that wants no response."""
        self.channel.receive(json.dumps({"jsonrpc": "2.0", "method": method, "params": params}))

    def of(self, method: str) -> list[dict[str, Any]]:
        """Return the notifications of a kind."""
        return [params for name, params in self.heard if name == method]

    async def until(self, method: str, count: int = 1) -> dict[str, Any]:
        """Return the `count`-th notification of a kind, waiting for it if necessary."""
        async with asyncio.timeout(60):
            while len(self.of(method)) < count:
                self._changed.clear()
                await self._changed.wait()
        return self.of(method)[count - 1]


class Shared:
    """A hub on a virtual board."""

    def __init__(self, hub: Hub, virtual: VirtualBoard) -> None:
        self.hub = hub
        self.virtual = virtual
        self.interface = ControlInterface(hub)

    async def states(self) -> tuple[ServoState, ...]:
        """Return what the servos report, past all programs."""
        return (await self.hub.board.connection.request(QueryServoRequest(ALL_SERVOS))).servos

    def angle(self, servo_id: int) -> float:
        """Return where a servo is now."""
        self.virtual.advance(asyncio.get_running_loop().time())
        return self.virtual.servos[servo_id].angle

    @asynccontextmanager
    async def program(
        self, who: str = "studio", role: RoleName = "edit", session: str | None = None, dead_man: float | None = None
    ) -> AsyncIterator[RpcProgram]:
        """Connect a program to the control interface."""
        greeting = Greeting(wants="rpc", who=who, role=role, session=session, dead_man=dead_man)
        program = RpcProgram(self.hub, self.interface, greeting)
        try:
            yield program
        finally:
            await program.channel.close()


@asynccontextmanager
async def shared(servos: int = 3, kind: BoardKind = BoardKind.DEFAULT, **options: Any) -> AsyncIterator[Shared]:
    """Share a new virtual board."""
    virtual = VirtualBoard(servos, kind=kind)
    async with (
        connect(VirtualTransport(virtual), angle_unit=None, **options) as upstream,
        share(upstream, name="rex") as hub,
    ):
        here = Shared(hub, virtual)
        try:
            yield here
        finally:
            await here.interface.close()
