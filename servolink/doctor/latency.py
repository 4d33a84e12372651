"""The latency timer of FTDI adapters: seen in the system, and in the round trips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from servolink.doctor.facts import SystemFacts
from servolink.doctor.finding import Finding
from servolink.doctor.nodes import device_of

CHECK = "latency timer"
_MEANS = "an FTDI adapter holds short answers back until its latency timer, usually 16 ms, has run out"
_LONGEST = 2  # milliseconds that nobody notices
_NEAR_16_MS = (0.0135, 0.0185)  # seconds; the timer itself, and the short way there and back
_FEWEST = 10  # round trips from which something can be said


def check_latency_timer(facts: SystemFacts, url: str) -> Iterator[Finding]:
    """Find a latency timer that is set as it comes from the factory."""
    name = PurePosixPath(facts.real(device_of(url))).name
    path = f"/sys/bus/usb-serial/devices/{name}/latency_timer"
    timer = facts.text(path)
    if timer.isdecimal() and int(timer) > _LONGEST:
        yield Finding(CHECK, f"{path} is {timer} ms", _MEANS, _cure(facts, name))


def check_round_trips(facts: SystemFacts, url: str, round_trips: Sequence[float]) -> Iterator[Finding]:
    """Find round trips, in seconds, that cluster where the timer puts them."""
    low, high = _NEAR_16_MS
    near = [seconds for seconds in round_trips if low <= seconds <= high]
    if len(round_trips) >= _FEWEST and len(near) * 2 >= len(round_trips):
        name = PurePosixPath(facts.real(device_of(url))).name
        seen = f"{len(near)} of {len(round_trips)} answers took {low * 1000:g} to {high * 1000:g} ms"
        yield Finding(CHECK, seen, f"this is what it looks like when {_MEANS}", _cure(facts, name))


def _cure(facts: SystemFacts, name: str) -> str:
    if facts.platform == "win32":
        return f"Device Manager, Ports, {name}, Properties, Port Settings, Advanced: Latency Timer 1 ms"
    if facts.platform == "linux" and name.startswith("ttyUSB"):
        return (
            f"until it is unplugged: echo 1 | sudo tee /sys/bus/usb-serial/devices/{name}/latency_timer\n"
            "for good: the rule that `servolink doctor --print-udev` prints"
        )
    return "set the latency timer of the adapter to 1 ms where it is plugged in"
