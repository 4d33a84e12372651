"""Measure the guard of a hub on bodies with physics: false alarms, and seconds until a stall is found.

`python -m tests.hub.guard_measured --minutes 60 --trials 100` prints both. Each recording has a seed, which chooses
figure, load (50 to 150 %), rate of readings, noise, and how many readings are lost and late. Seeds below 1,000,000 are
for choosing thresholds; the default begins above.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator
from random import Random
from typing import NamedTuple

from msgspec.structs import replace

from servolink.client import Servo
from servolink.hub.rules.courses import Courses
from servolink.hub.rules.guard import AFTERWARDS, Guard, Stall
from servolink.motion import Degrees, doubts
from servolink.protocol import ExecuteActionRequest, ServoState, SetServoParameterRequest, Step
from tests.twin.hung_body import HungBody

FIRST_SEED = 1_000_000
STILL, BEHIND = 3.0, 8.0
"""Degrees per second and degrees: a servo slower than this and farther behind is stalled, if it draws its most."""

_FIGURES = ("arm-6", "quadruped-12", "hexapod-18", "humanoid-16")
_REACH = 35  # degrees to both sides of the rest, in which the parts of these figures do not meet
_REPEATED_AFTER = 0.1  # seconds from a lost response to the next
_SHARE = 0.97  # of the highest current, from which a servo draws its most


class Found(NamedTuple):
    """Stall that the guard has found, and when it began; None for a false alarm."""

    stall: Stall
    seconds: float | None


class Recording:
    """Body that is moved at random, read over a poor line by a guard."""

    def __init__(self, seed: int, hz: float | None = None) -> None:
        self.random = random = Random(seed)
        self.figure = random.choice(_FIGURES)
        self.hz = hz or random.choice((10.0, 20.0, 50.0))
        hung = HungBody(self.figure, seed)
        self.physics, self.servos, self.body = hung.physics, hung.servos, hung.simulation
        self.load = random.uniform(0.5, 1.5)
        self.physics.vary(mass=self.load, stiffness=random.uniform(0.8, 1.2))
        self.guard, self.courses = Guard(), Courses()
        self.found: list[Found] = []
        self.stalled_since: dict[int, float] = {}
        self._noise = random.uniform(5, 60)  # raw current
        self._lost, self._late = random.uniform(0, 0.05), random.uniform(0, 0.1)
        self._before: dict[int, tuple[float, float]] = {}
        self._next_reading = 0.0
        self._taken: tuple[float, list[Servo]] | None = None  # reading on its way, and when it arrives

    @property
    def now(self) -> float:
        return self.body.now

    def send(self, targets: dict[int, float], seconds: float) -> None:
        """Move servos, as a hub does."""
        steps = tuple(Step(servo_id, round(target), round(seconds * 100)) for servo_id, target in targets.items())
        self.courses.sent(ExecuteActionRequest(steps), self.now, lambda _: "degree", 0.01)
        self._next_reading = min(self._next_reading, self.now)  # faster from now on
        for step in steps:
            self.servos[step.servo_id].move(step.degree, step.seconds, self.now)

    def advance(self, seconds: float) -> None:
        """Let time pass, with readings."""
        until = self.now + seconds
        while self.now < until:
            self.body.tick()
            self._look()
            if self._taken is not None and self.now >= self._taken[0]:
                _, servos = self._taken
                self._taken = None
                self._hear(servos)
            if self._taken is None and self.now >= self._next_reading:
                self._read()

    def _look(self) -> None:
        """Find out which servos are truly stalled now."""
        if round(self.now * 100) % 2:
            return
        for servo_id, servo in self.servos.items():
            way, (then, before) = self.courses.way(servo_id), self._before.get(servo_id, (self.now, servo.position))
            speed = abs(servo.position - before) / (self.now - then) if self.now > then else 0.0
            self._before[servo_id] = self.now, servo.position
            is_commanded = way is not None and way.began <= self.now <= way.began + way.seconds + AFTERWARDS
            behind = abs(way.at(self.now) - servo.position) if way is not None and is_commanded else 0.0
            if behind > BEHIND and speed < STILL and servo.current >= _SHARE * servo.MAX_CURRENT:
                self.stalled_since.setdefault(servo_id, self.now)
            elif behind <= BEHIND:
                self.stalled_since.pop(servo_id, None)

    def _read(self) -> None:
        """Read the servos; the response may be lost, or late."""
        is_moving = self.now <= self.courses.end_of_motion() + AFTERWARDS
        self._next_reading = self.now + (1 / self.hz if is_moving else 1.0)
        if self.random.random() < self._lost:
            self._next_reading = self.now + _REPEATED_AFTER
            return
        late = self.random.expovariate(20) if self.random.random() < self._late else 0.005
        states = [self._noisy(servo.state()) for servo in self.servos.values()]
        doubtful = doubts(states, lambda _: "degree")
        servos = [
            Servo(each.servo_id, Degrees(each.angle), each.current, each.temperature, 1, bool(each.is_start),
                  bool(each.is_hold), doubtful.get(each.servo_id, ""))
            for each in states
        ]  # fmt: skip
        self._taken = self.now + min(late, 0.5), servos

    def _noisy(self, state: ServoState) -> ServoState:
        jitter = self.random.choice((-1, 1)) if self.random.random() < 0.05 else 0
        current = max(0, round(state.current + self.random.gauss(0, self._noise)))
        return replace(state, angle=state.angle + jitter, current=current)

    def _hear(self, servos: list[Servo]) -> None:
        for stall in self.guard.stalls(servos, self.courses.way, self.now):
            since = self.stalled_since.get(stall.servo_id)
            self.found.append(Found(stall, None if since is None else self.now - since))
        self.courses.seen({servo.servo_id: int(servo.angle) for servo in servos if not servo.doubt}, self.now)

    def act(self) -> None:
        """Do one thing that people and programs do, and wait a while."""
        random, ids = self.random, list(self.servos)
        chosen = random.sample(ids, random.randint(1, min(4, len(ids))))
        match random.random():
            case kind if kind < 0.7:  # a movement, perhaps cut short by the next
                targets = {each: self._target(each) for each in chosen}
                seconds = random.uniform(0.4, 3.0)
                self.send(targets, seconds)
                self.advance(seconds * random.uniform(0.3, 1.0) if random.random() < 0.3 else seconds)
            case kind if kind < 0.85:  # a stream of set-points
                middle, begun = {each: self._target(each) for each in chosen}, self.now
                self.send(middle, 1.0)
                self.advance(1.0)
                while self.now < begun + 4:
                    wave = 10 * math.sin(2 * (self.now - begun - 1))
                    self.send({each: self._within(each, angle + wave) for each, angle in middle.items()}, 0.1)
                    self.advance(0.05)
            case _:  # a person turns a servo by hand
                servo = self.servos[chosen[0]]
                for flags in ((1, 0), (1, 1)):
                    self.courses.sent(SetServoParameterRequest(chosen[0], *flags), self.now, lambda _: "degree", 0.01)
                    servo.set_flags(*flags, self.now)
                    self.advance(random.uniform(0.5, 2))
        self.advance(random.choice((0.0, 0.3, 1.5, 5.0)))

    def _target(self, servo_id: int) -> float:
        low, high = self.limits(servo_id)
        rest = min(max(0.0, low), high)
        return self.random.uniform(max(low + 1, rest - _REACH), min(high - 1, rest + _REACH))

    def _within(self, servo_id: int, angle: float) -> float:
        low, high = self.limits(servo_id)
        return min(max(angle, low + 1), high - 1)

    def limits(self, servo_id: int) -> tuple[float, float]:
        """Return the angles, in degrees, that the joint of a servo can reach."""
        joint = self.physics.model.actuator_trnid[self.physics.servo_ids.index(servo_id), 0]
        low, high = self.physics.model.jnt_range[joint]
        return math.degrees(low), math.degrees(high)

    def known(self) -> list[int]:
        """Return the servos whose normal is known."""
        return [each for each in self.servos if (normal := self.guard.normal(each)) is not None and normal.is_known]

    def stall(self) -> str:
        """Move a servo against an obstacle, a limit of its joint, or a load that it cannot lift; return which."""
        random = self.random
        kind = random.choice(("obstacle", "joint limit", "heavy load"))
        servo_id = random.choice(self.known())
        servo = self.servos[servo_id]
        low, high = self.limits(servo_id)
        sign = random.choice((-1, 1))
        if kind == "joint limit":
            edge = high if sign > 0 else low
            self.send({servo_id: edge - sign * 30}, 1.0)
            self.advance(3.0)
            self.send({servo_id: edge + sign * random.uniform(15, 40)}, random.uniform(0.4, 1.5))
        elif kind == "obstacle":
            edge = servo.position + sign * random.uniform(2, 20)
            joint = self.physics.model.actuator_trnid[self.physics.servo_ids.index(servo_id), 0]
            self.physics.model.jnt_range[joint, (sign + 1) // 2] = math.radians(edge)
            self.send({servo_id: edge + sign * random.uniform(15, 40)}, random.uniform(0.4, 1.5))
        else:
            self.physics.vary(mass=self.load * random.uniform(4, 8))
            self.send({servo_id: servo.angle + sign * random.uniform(30, 60)}, random.uniform(0.4, 1.5))
        return kind


def false_alarms(seed: int, minutes: float) -> Iterator[str]:
    """Yield a text for each alarm in a recording without stalls."""
    recording = Recording(seed)
    while recording.now < minutes * 60:
        recording.act()
        for found in recording.found:
            note = "false" if found.seconds is None else "a true stall"
            yield f"seed {seed}, {recording.figure}, {recording.load:.2f} of its load: {note}: {found.stall}"
        recording.found.clear()


def detection(seed: int, hz: float) -> tuple[str, float | None] | None:
    """Return what stalled a servo, and the seconds until it was found, None if never; None without a true stall."""
    recording = Recording(seed, hz)
    while recording.now < 60 or not recording.known():
        recording.act()
    recording.advance(3.0)
    recording.found.clear()
    recording.stalled_since.clear()
    kind = recording.stall()
    until, longest = recording.now + 5, dict[int, float]()
    while recording.now < until:
        recording.advance(0.02)
        if found := [each.seconds for each in recording.found if each.seconds is not None]:
            return kind, found[0]
        for servo_id, since in recording.stalled_since.items():
            longest[servo_id] = recording.now - since
        if recording.found:  # before the stall was complete
            return kind, 0.0
    return (kind, None) if max(longest.values(), default=0) > 1.0 else None


def main() -> None:
    """Print false alarms and times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60, help="of recordings without stalls")
    parser.add_argument("--trials", type=int, default=100, help="stalls, at 10 and at 50 Hz each")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    args = parser.parse_args()
    begun, recorded, alarms, seed = time.monotonic(), 0.0, Counter[str](), args.seed
    while recorded < args.minutes:
        for text in false_alarms(seed, min(15.0, args.minutes)):
            alarms[text.split(": ")[1]] += 1
            print(text)
        recorded, seed = recorded + min(15.0, args.minutes), seed + 1
        print(f"{recorded / 60:.2f} h, alarms {dict(alarms)}, {time.monotonic() - begun:.0f} s", flush=True)
    for hz, most in ((10.0, 1.0), (50.0, 0.5)):
        times, seed = list[tuple[str, float | None]](), args.seed + 500_000
        while len(times) < args.trials:
            if (found := detection(seed, hz)) is not None:
                times.append(found)
                if found[1] is None or found[1] > most:
                    print(f"seed {seed}, {hz:g} Hz: {found}")
            seed += 1
        good = sorted(seconds for _, seconds in times if seconds is not None)
        in_time = sum(seconds <= most for seconds in good)
        kinds = dict(Counter(kind for kind, _ in times))
        print(f"{hz:g} Hz: {in_time} of {len(times)} within {most:g} s, {kinds}; median {good[len(good) // 2]:.2f} s, "
              f"longest {good[-1]:.2f} s", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
