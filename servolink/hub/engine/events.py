"""ButtonRelay: one subscription of the board for all programs that want its button events (3.4.7, 3.4.8)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from servolink.client.board import Board
from servolink.client.events import ButtonEvent, ButtonEvents
from servolink.errors import ConnectionLost, Rejected, ServolinkError
from servolink.hub.rules.exchanges import Asker
from servolink.hub.rules.session_state import Subscribers
from servolink.protocol.codec import in_range
from servolink.protocol.joystick import SubscribeButtonEventRequest, SubscribeButtonEventResponse


class ButtonRelay:
    """Subscribes the board for the first program, ends that with the last, and passes events on."""

    def __init__(self, board: Board, deliver: Callable[[ButtonEvent], None]) -> None:
        """Call `deliver` with each event of `board`."""
        self.subscribers = Subscribers()
        self._board = board
        self._deliver = deliver
        self._events: ButtonEvents | None = None
        self._reading: asyncio.Task[None] | None = None
        self._changing = asyncio.Lock()

    async def set(self, program: Asker, packet: SubscribeButtonEventRequest) -> SubscribeButtonEventResponse:
        """Subscribe a program or end that, and return the response for it."""
        if not in_range(packet):
            return SubscribeButtonEventResponse(0)
        subscribe = bool(packet.subscribe)
        async with self._changing:
            if self.subscribers.must_ask(program.session_id, subscribe=subscribe):
                try:
                    await self._ask(subscribe=subscribe)
                except Rejected:
                    return SubscribeButtonEventResponse(0)
            self.subscribers.change(program.session_id, subscribe=subscribe)
            program.state.is_subscribed = subscribe
        if program.has_left:  # while the board was asked: there was no subscription yet that could be ended
            await self.left(program.session_id)
        return SubscribeButtonEventResponse(1)

    async def left(self, session_id: str) -> None:
        """End the subscription of a program that is gone."""
        async with self._changing:
            if self.subscribers.left(session_id):
                with suppress(ServolinkError):  # nobody wants them any more; events that still come are not passed on
                    await self._ask(subscribe=False)

    async def close(self) -> None:
        """Pass no further events on. The board ends its subscription when it is closed."""
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.wait((self._reading,))

    async def _ask(self, *, subscribe: bool) -> None:
        """Ask the board, which raises Rejected if it refuses."""
        self.subscribers.asking()
        if subscribe:
            events = self._events or self._board.button_events()
            await events.__aenter__()
            self._events = events
            if self._reading is None:
                self._reading = asyncio.get_running_loop().create_task(self._read(events))
        elif self._events is not None:
            reading, events, self._reading, self._events = self._reading, self._events, None, None
            if reading is not None:
                reading.cancel()
            await events.aclose()
        self.subscribers.answered(subscribe=subscribe)

    async def _read(self, events: ButtonEvents) -> None:
        with suppress(ConnectionLost):
            async for event in events:
                self._deliver(event)
