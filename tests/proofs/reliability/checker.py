"""The checker knows the truth about a conversation, and compares what each side made of it with that.

It judges two things. Every answer that a caller got must be the one to a sending of that very call. Everything
that the board did must have been asked, and what moves or changes something at most once for each call.
"""

from __future__ import annotations

import contextvars
import hashlib
from collections import Counter, deque
from dataclasses import dataclass, field
from struct import pack

from servolink.protocol import (
    ClearAllDataRequest,
    Command,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    Query,
    QueryServoListRequest,
    Request,
    Response,
    SetServoParameterRequest,
)
from tests.client.numbered_board import ABSENT, numbered

MOTION = (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)
ONCE = (*MOTION, ClearAllDataRequest)
"""What must never happen twice."""
_SHOWN = 30  # of the latest events
_KEPT = 1_000  # of the latest sendings; nothing takes longer


@dataclass(slots=True, eq=False)
class Call:
    """One call of the program under test."""

    step: int
    request: Packet
    is_stop: bool = False
    timeout: float | None = None
    begun: int = 0
    """How many sendings there had been."""
    until: float = float("inf")
    """When its own time ends."""
    sent: list[int] = field(default_factory=list)
    """Its sendings of `request`; fences are not among them."""
    executed: int = 0


@dataclass(slots=True, eq=False)
class Sending:
    """One frame from the program to the board."""

    call: Call | None
    packet: Packet
    deadline: float = 0.0
    answer_arrives: float | None = None
    """When the last byte of its answer is ready to be read, whole; None if that never happens."""


CALL: contextvars.ContextVar[Call | None] = contextvars.ContextVar("CALL", default=None)
"""The call in whose name is being sent."""


class Checker:
    """Judge of one history."""

    def __init__(self, *, damaging: bool, repeating: bool, ambiguous: bool) -> None:
        """Forgive what damage that the checksum did not show, or an answer that came twice, explains.

        `ambiguous`: several requests may be under way, so that a response that came in time may have to be kept until
        others prove whose it is.
        """
        self.faults: list[str] = []
        """What must not be."""
        self.counts: Counter[str] = Counter()
        self.unknown: deque[Call] = deque(maxlen=_KEPT)
        """The calls whose outcome was left open."""
        self.number = 0
        """Of the latest sending; the first is 1."""
        self.sendings: dict[int, Sending] = {}
        """The latest, by number."""
        self._damaging = damaging
        self._repeating = repeating
        self._ambiguous = ambiguous
        self._false: deque[Packet] = deque(maxlen=_KEPT)
        self._damage: deque[tuple[int, Packet]] = deque(maxlen=_KEPT)  # what the board was told by nobody
        self._stopped_at = 0
        self._stops_singly = False  # since a stop got no reading of all servos, and asked which servos there are
        self._free_at = 0.0  # when the latest answer arrives
        self._alone_until = 0.0  # when the answer to the latest request arrives that bears nothing beside it
        self._digest = hashlib.blake2b(digest_size=16)
        self.latest: deque[tuple[float, str, bytes | str]] = deque(maxlen=_SHOWN)
        """The last events before the first fault."""

    # --- the history --------------------------------------------------------------------------------------------

    def note(self, now: float, event: str, what: bytes | str) -> None:
        """Let an event be part of the history."""
        self._digest.update(pack("<d", now))
        self._digest.update(event.encode())
        self._digest.update(what.encode() if isinstance(what, str) else what)
        if not self.faults:
            self.latest.append((now, event, what))

    @property
    def digest(self) -> str:
        """A number that is the same only for the same history."""
        return self._digest.hexdigest()

    def fault(self, step: int, what: str) -> None:
        """Note what must not be."""
        self.faults.append(f"step {step}: {what}")

    # --- what is sent and done ----------------------------------------------------------------------------------

    def sends(self, packet: Packet, now: float, deadline: float, call: Call | None) -> int:
        """Return the number of the sending that begins, in the name of `call`; None for a handshake."""
        number = self._begin(Sending(call, packet, deadline))
        if isinstance(packet, Command):
            self.counts["commands sent"] += 1
        if call is None:
            return number
        if packet != call.request:
            self._stops_singly |= call.is_stop and isinstance(packet, QueryServoListRequest)
            if not isinstance(packet, Query) and not self._is_single_stop(call, packet):
                self.fault(call.step, f"{packet} was sent, which {call.request} does not need")
            return number
        self._overlooks(call, call.sent[-1:])
        call.sent.append(number)
        if call.is_stop and isinstance(packet, SetServoParameterRequest):
            self._stopped_at = number
        elif isinstance(packet, MOTION) and call.begun < self._stopped_at:
            self.fault(call.step, f"{packet} was sent after a stop that was asked for later")
        if len(call.sent) > 1 and not packet.repeatable and not call.is_stop:
            self.fault(call.step, f"{packet} was sent again")
        if (
            len(call.sent) == 1
            and not (call.is_stop or self._damaging or self._repeating)
            and now < (self._free_at if packet.exclusive else self._alone_until)
        ):
            self.counts["sent beside others"] += 1
            self.fault(call.step, f"{packet} was sent beside others")
        return number

    def _is_single_stop(self, call: Call, packet: Packet) -> bool:
        """Return whether a stop goes to one servo too, as a board may ignore the id of all servos."""
        if not (self._stops_singly and call.is_stop and isinstance(packet, SetServoParameterRequest)):
            return False
        self.counts["single stops"] += 1
        return (packet.is_start, packet.is_hold) == (0, 1)

    def _overlooks(self, call: Call, numbers: list[int]) -> None:
        """Look for an answer that came in time, and was not delivered."""
        if self._damaging or self._ambiguous or self._repeating or isinstance(call.request, SetServoParameterRequest):
            return
        for number in numbers:
            sending = self.sendings[number]
            arrives, deadline = sending.answer_arrives, min(sending.deadline, call.until)
            if number % ABSENT == 0 and isinstance(call.request, Request) and call.request.echoed:
                continue  # "none" may have to be kept: it also fits a repeat for another record, whose answer was lost
            if arrives is not None and arrives <= deadline:
                self.counts["lost in time"] += 1
                self.fault(call.step, f"the answer to {call.request} came {deadline - arrives:.6f} s early")

    def arrives(self, number: int, when: float | None) -> None:
        """Note when the answer to a sending will have arrived whole; None if it never will."""
        sending = self.sendings[number]
        sending.answer_arrives = when
        if when is None or (sending.call is not None and sending.call.is_stop):
            return
        self._free_at = max(self._free_at, when)
        if sending.packet.exclusive:
            self._alone_until = max(self._alone_until, when)

    def executes(self, number: int | None, packet: Packet) -> int:
        """Note what the board does, and return the number that its answer must show."""
        if number is None:
            self.counts["damaged commands executed"] += 1
            if not self._damaging:
                self.fault(0, f"the board was told {packet}, which nobody sent")
            number = self._begin(Sending(None, packet))
            self._damage.append((number, packet))
            return number
        sending = self.sendings[number]
        if packet != sending.packet:
            self.fault(0, f"the board was told {packet} instead of {sending.packet}")
        call = sending.call
        if call is not None and packet == call.request:
            call.executed += 1
            self.counts["executed"] += 1
            if isinstance(packet, Command):
                self.counts["commands executed"] += 1
            if isinstance(packet, ONCE):
                self.counts["motion and clearing"] += 1
            if call.executed > 1 and not packet.repeatable and not call.is_stop:
                self.counts["executed twice"] += 1
                self.fault(call.step, f"{packet} was executed {call.executed} times")
        return number

    def false_frame(self, packet: Packet | None) -> None:
        """Note that the program believed an answer that no board gave."""
        self.counts["false accepts"] += 1
        if not self._damaging:
            self.fault(0, f"{packet} was believed, which no board said")
        if packet is not None:
            self._false.append(packet)

    # --- how a call ends ----------------------------------------------------------------------------------------

    # Each returns the name under which the end of the call is counted.

    def answered(self, call: Call, answer: Response) -> str:
        """Judge an answer."""
        if any(answer == numbered(call.request, number) for number in self._origins(call)):
            return "right"
        if answer in self._false or self._answers_damage(call, answer):
            return "damage accepted"
        if self._repeating:
            return "of a repeated answer"
        before = (number for number, sending in self.sendings.items() if sending.packet == call.request)
        kind = "stale" if any(answer == numbered(call.request, number) for number in before) else "wrong"
        self.fault(call.step, f"{call.request} got {answer}, which is {kind}; its own sendings are {call.sent}")
        return kind

    def _origins(self, call: Call) -> list[int]:
        """Return the sendings whose answers are right: those of the call, and equal ones of others since its first."""
        if not call.request.repeatable:
            return call.sent
        numbers = range(call.sent[0], self.number + 1)
        return [number for number in numbers if self.sendings[number].packet == call.request]

    def unanswered(self, call: Call, *, unknown: bool) -> str:
        """Judge an error that says that no answer came."""
        if not unknown and not isinstance(call.request, Query) and call.sent:
            self.fault(call.step, f"{call.request} was sent and is said to have changed nothing")
        if unknown and not call.sent:
            self.fault(call.step, f"{call.request} was never sent and is said to be in doubt")
        self._overlooks(call, call.sent)
        if unknown:
            self.unknown.append(call)
        return "outcome unknown" if unknown else "timed out"

    def refused(self, call: Call) -> str:
        """Judge an error that says that nothing was sent."""
        if call.sent:
            self.fault(call.step, f"{call.request} was sent and is said to be refused")
        return "refused"

    def undecodable(self, call: Call) -> str:
        """Judge an error that says that an answer made no sense."""
        if not self._damaging:
            self.fault(call.step, f"the answer to {call.request} made no sense")
        return "undecodable"

    def _begin(self, sending: Sending) -> int:
        self.number += 1
        self.sendings[self.number] = sending
        self.sendings.pop(self.number - _KEPT, None)
        return self.number

    def _answers_damage(self, call: Call, answer: Response) -> bool:
        return any(
            type(packet) is type(call.request) and answer == numbered(packet, number) for number, packet in self._damage
        )
