"""The judge of programs that share a board: each response must be the one to a request of that very program.

What programs ask is made unmistakable where a packet has room for it: every id, caption and interval is used once, so
that the judge knows from a packet that the board got whose it is.
"""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from dataclasses import dataclass

from servolink.protocol import (
    ALL_SERVOS,
    AddServoParameterRequest,
    ClearAllDataRequest,
    ClearAllDataResponse,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    Query,
    Response,
    Result,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    SubscribeButtonEventRequest,
    SubscribeButtonEventResponse,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from tests.client.numbered_board import numbered

MOTION = (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest, AddServoParameterRequest)
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)

_SHOWN = 40  # of the latest events
_KEPT = 1_000  # of the latest sendings; nothing takes longer


_DONE: dict[type[Packet], type[Result]] = {
    SubscribeButtonEventRequest: SubscribeButtonEventResponse,
    WriteProjectIDRequest: WriteProjectIDResponse,
    ClearAllDataRequest: ClearAllDataResponse,
}


def shared_board_response(request: Packet, number: int) -> Response:
    """Return the response to sending `number`; what the hub itself reads is answered truthfully, without a number."""
    if isinstance(request, SetAngleUnitRequest):
        return SetAngleUnitResponse(request.servo_id, request.unit_type)
    if (declared := _DONE.get(type(request))) is not None:
        return declared(1)
    return numbered(request, number)


@dataclass(slots=True, eq=False)
class Asked:
    """One request of one program."""

    number: int
    program: str
    unit: int
    """The program's angle unit, as in the packet that sets it."""
    request: Packet
    sendings: int
    """How many sendings there had been."""
    at_once: bool
    """Whether the hub had it as soon as it was asked."""


class HubChecker:
    """Judge of one history."""

    def __init__(self, *, damaging: bool, repeating: bool) -> None:
        """Forgive what damage that the checksum did not show, or a response that came twice, explains."""
        self.faults: list[str] = []
        """What must not be."""
        self.counts: Counter[str] = Counter()
        self.latest: deque[tuple[float, str, str]] = deque(maxlen=_SHOWN)
        """The last events before the first fault."""
        self.number = 0
        """Of the latest sending; the first is 1."""
        self._sendings: dict[int, Packet] = {}
        self._asked: defaultdict[Packet, list[Asked]] = defaultdict(list)
        self._executed: Counter[Packet] = Counter()
        self._requests = 0
        self._stop_asked = 0  # the number of the latest request to stop
        self._stopped = 0  # the same once it was sent
        self._units: dict[int, int] = {}  # by servo, as the board was told
        self._damaging = damaging
        self._repeating = repeating
        self._false: deque[Packet] = deque(maxlen=_KEPT)
        self._damage: deque[tuple[int, Packet]] = deque(maxlen=_KEPT)  # what the board was told by nobody

    # --- the history --------------------------------------------------------------------------------------------

    def note(self, now: float, event: str, what: str) -> None:
        """Add an event to those that are shown with a fault."""
        if not self.faults:
            self.latest.append((now, event, what))

    def fault(self, what: str) -> None:
        """Note what must not be."""
        self.faults.append(f"request {self._requests}: {what}")

    # --- what is asked, sent and done ---------------------------------------------------------------------------

    def asks(self, program: str, unit: int, request: Packet, *, at_once: bool) -> Asked:
        """Note that a program asks for something now."""
        self._requests += 1
        asked = Asked(self._requests, program, unit, request, self.number, at_once)
        self._asked[request].append(asked)
        self.counts["requests"] += 1
        if request == STOP:
            self._stop_asked = asked.number
        return asked

    def sends(self, packet: Packet) -> int:
        """Return the number of the sending that begins."""
        self.number += 1
        self._sendings[self.number] = packet
        self._sendings.pop(self.number - _KEPT, None)
        if packet == STOP:
            self._stopped = self._stop_asked
        for asked in self._asked.get(packet, ()) if isinstance(packet, MOTION) else ():
            if asked.at_once and asked.number < self._stopped:
                self.fault(f"{packet} was sent after a stop that was asked for later")
        return self.number

    def arrives(self, number: int, when: float | None) -> None:
        """Do nothing: whether a response comes in time is not judged here."""

    def executes(self, number: int | None, packet: Packet) -> int:
        """Note what the board does, and return the number that its response must show."""
        if number is None:
            self.counts["damaged commands executed"] += 1
            if not self._damaging:
                self.fault(f"the board was told {packet}, which nobody sent")
            self.number += 1
            self._sendings[self.number] = packet
            self._damage.append((self.number, packet))
            self._set_unit(packet)
            return self.number
        self._executed[packet] += 1
        self._set_unit(packet)
        asked = self._asked.get(packet, [])
        if isinstance(packet, MOTION):
            self.counts["motion executed"] += 1
            self._check_unit(packet, asked)
        if packet.repeatable or packet == STOP or self._is_single_stop(packet):
            return number
        if not asked:
            self.fault(f"{packet} was executed and asked for by nobody")
        elif self._executed[packet] > len(asked):
            self.counts["executed twice"] += 1
            self.fault(f"{packet} was executed {self._executed[packet]} times and asked for {len(asked)} times")
        return number

    def _is_single_stop(self, packet: Packet) -> bool:
        """Return whether a stop goes to one servo too, as a board may ignore the id of all servos."""
        if not self._stop_asked or not isinstance(packet, SetServoParameterRequest):
            return False
        return (packet.is_start, packet.is_hold) == (STOP.is_start, STOP.is_hold)

    def false_frame(self, packet: Packet | None) -> None:
        """Note that the hub believed a response that no board gave."""
        self.counts["false accepts"] += 1
        if not self._damaging:
            self.fault(f"{packet} was believed, which no board said")
        if packet is not None:
            self._false.append(packet)

    def _set_unit(self, packet: Packet) -> None:
        if isinstance(packet, SetAngleUnitRequest):
            if packet.servo_id == ALL_SERVOS:
                self._units = dict.fromkeys(range(ALL_SERVOS), packet.unit_type)
            else:
                self._units[packet.servo_id] = packet.unit_type

    def _check_unit(self, packet: Packet, asked: list[Asked]) -> None:
        """Compare the unit of the board with that of the program whose angles it gets."""
        if not isinstance(packet, ExecuteActionRequest) or self._damaging or not asked:
            return
        for step in packet.steps:
            if self._units.get(step.servo_id) != asked[0].unit:
                self.fault(
                    f"{asked[0].program} counts in unit {asked[0].unit}, and servo {step.servo_id} was moved in unit "
                    f"{self._units.get(step.servo_id)}"
                )

    # --- how a request ends -------------------------------------------------------------------------------------

    def answered(self, asked: Asked, response: Response) -> None:
        """Judge a response."""
        self.counts[self._judge(asked, response)] += 1

    def unanswered(self, asked: Asked) -> None:
        """Count a request that was not answered."""
        self.counts["no response"] += 1

    def unasked(self, program: str, response: Packet) -> None:
        """Judge a response that fits nothing a program asks: a wrong one to what it asked before, at best."""
        if self._repeating:
            self.counts["of a repeated response"] += 1
        elif response in self._false:
            self.counts["damage accepted"] += 1
        else:
            self.counts["wrong"] += 1
            self.fault(f"{program} got {response}, which it had not asked for")

    def hung(self, asked: Asked) -> None:
        """Judge a request that neither ends nor fails."""
        self.counts["hung"] += 1
        self.fault(f"{asked.program}: {asked.request} does not end")

    def _judge(self, asked: Asked, response: Response) -> str:
        request = asked.request
        if self._is_local(request, response):
            return "answered by the hub"
        if any(
            packet == request and response == shared_board_response(request, number)
            for number, packet in self._sendings.items()
            if number > asked.sendings
        ):
            return "right"
        if self._is_refused(request, response):
            return "refused"
        if response in self._false or self._answers_damage(request, response):
            return "damage accepted"
        if self._repeating:
            return "of a repeated response"
        before = (number for number, packet in self._sendings.items() if packet == request)
        kind = "stale" if any(response == shared_board_response(request, number) for number in before) else "wrong"
        self.fault(f"{asked.program}: {request} got {response}, which is {kind}; sendings before it: {asked.sendings}")
        return kind

    def _is_local(self, request: Packet, response: Response) -> bool:
        """Return whether the hub answers this by itself, or by what it read back."""
        if isinstance(request, TransmissionModeSettingRequest):
            return getattr(response, "result", None) == request.mode
        return request == STOP and isinstance(response, SetServoParameterResponse)

    def _is_refused(self, request: Packet, response: Response) -> bool:
        """Return whether a motion was refused for want of the lease; then it must never be done."""
        if isinstance(request, SetServoParameterRequest):
            return isinstance(response, SetServoParameterResponse)
        if not isinstance(request, MOTION) or getattr(response, "result", None) != 0:
            return False
        if self._executed[request]:
            self.fault(f"{request} was refused and executed")
        return True

    def _answers_damage(self, request: Packet, response: Response) -> bool:
        return any(
            type(packet) is type(request) and response == shared_board_response(packet, number)
            for number, packet in self._damage
        )


def is_change(request: Packet) -> bool:
    """Return whether a request changes something, so that it must not be asked beside others without the library."""
    return not isinstance(request, Query)
