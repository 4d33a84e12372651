"""ButtonRelay: shared subscription of the board for all programs with button events (3.4.7, 3.4.8)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

from servolink.client import Board, ButtonEvent, ButtonEvents
from servolink.errors import ConnectionLost, Rejected, ServolinkError
from servolink.hub.rules.exchanges import Asker
from servolink.protocol import PACKETS, Result, SubscribeButtonEventRequest


class Subscribers:
    """Programs with button events: the first subscribes the board, the last ends the subscription (3.4.7).

    Requests of 40070 must be sent one after the other, since a repeated one would undo a later one.
    """

    def __init__(self) -> None:
        """Start without subscribers, on a board whose subscription is unknown."""
        self._programs: set[str] = set()
        self._is_on: bool | None = None

    @property
    def is_wanted(self) -> bool:
        """Whether a program wants button events, so that a new connection must subscribe again."""
        return bool(self._programs)

    def __contains__(self, session_id: str) -> bool:
        """Return whether button events are sent to a program."""
        return session_id in self._programs

    def must_ask(self, session_id: str, *, subscribe: bool) -> bool:
        """Return whether the board must be asked before a program is answered; if not, the answer is success."""
        if subscribe:
            return self._is_on is not True
        return self._is_on is not False and not self._programs - {session_id}

    def asking(self) -> None:
        """Count the subscription of the board as unknown: a change is under way, or the board was connected again."""
        self._is_on = None

    def answered(self, *, subscribe: bool) -> None:
        """Count a change carried out by the board."""
        self._is_on = subscribe

    def change(self, session_id: str, *, subscribe: bool) -> None:
        """Add or remove a program, after the board has changed its subscription if `must_ask`."""
        if subscribe:
            self._programs.add(session_id)
        else:
            self._programs.discard(session_id)

    def left(self, session_id: str) -> bool:
        """Remove a program. Return whether the subscription of the board must end too."""
        was_subscribed = session_id in self._programs
        self._programs.discard(session_id)
        return was_subscribed and not self._programs and self._is_on is not False


class ButtonRelay:
    """Relay: subscribes for the first program, ends the subscription with the last, and passes events on."""

    def __init__(self, board: Board, deliver: Callable[[ButtonEvent], None]) -> None:
        self.subscribers = Subscribers()
        self._board = board
        self._deliver = deliver
        self._events: ButtonEvents | None = None
        self._reading: asyncio.Task[None] | None = None
        self._changing = asyncio.Lock()

    async def set(self, program: Asker, packet: SubscribeButtonEventRequest) -> Result:
        """Begin or end the subscription of a program, and return the response."""
        if not packet.is_in_range():
            return PACKETS.result_of(packet, done=False)
        subscribe = bool(packet.subscribe)
        async with self._changing:
            if self.subscribers.must_ask(program.session_id, subscribe=subscribe):
                try:
                    await self._ask(subscribe=subscribe)
                except Rejected:
                    return PACKETS.result_of(packet, done=False)
            self.subscribers.change(program.session_id, subscribe=subscribe)
            program.is_subscribed = subscribe
        if program.has_left:  # during the request: no subscription existed yet that could be ended
            await self.left(program.session_id)
        return PACKETS.result_of(packet, done=True)

    async def left(self, session_id: str) -> None:
        """End the subscription of a program after the program has left."""
        async with self._changing:
            if self.subscribers.left(session_id):
                with suppress(ServolinkError):  # no subscriber is left; late events are dropped
                    await self._ask(subscribe=False)

    async def close(self) -> None:
        """End the relay. Closing the board ends its subscription."""
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.wait((self._reading,))

    async def _ask(self, *, subscribe: bool) -> None:
        """Change the subscription of the board. Raise Rejected if the board refuses."""
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
