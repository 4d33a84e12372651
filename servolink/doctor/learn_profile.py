"""What was measured, and how it is merged into the profile that is kept of the board."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from msgspec.structs import asdict, replace

from servolink.profiles.profile import BY_HAND, BoardIdentityRecord, BoardProfile, Confidence, Evidence

_RANKS: dict[Confidence, int] = {"guess": 0, "likely": 1, "certain": 2}


@dataclass(frozen=True, slots=True)
class Measured:
    """One setting of a board, as it was measured."""

    setting: str
    """Its name in the profile."""
    value: Any
    """None if it could not be learnt."""
    confidence: Confidence
    evidence: str
    """What was seen, in one sentence with figures."""


def merge_profile(
    profile: BoardProfile, measured: Iterable[Measured], identity: BoardIdentityRecord, now: datetime
) -> BoardProfile:
    """Return `profile` with what was measured; limits, and what could not be learnt, stay.

    What is kept already is replaced unless the same value is kept with better evidence, or the user has set another
    value and the new one is not certain.
    """
    settings, evidence = profile.settings, dict(profile.evidence)
    for each in measured:
        if each.value is not None and _replaces(each, getattr(settings, each.setting), evidence.get(each.setting)):
            settings = replace(settings, **{each.setting: each.value})
            evidence[each.setting] = Evidence(each.confidence, each.evidence, now)
    return replace(profile, identity=_merged(profile.identity, identity), settings=settings, evidence=evidence)


def _replaces(measured: Measured, value: object, evidence: Evidence | None) -> bool:
    if value is None:
        return True
    if evidence is None or evidence.text == BY_HAND:
        return measured.confidence == "certain" or measured.value == value
    return measured.value != value or _RANKS[measured.confidence] >= _RANKS[evidence.confidence]


def _merged(kept: BoardIdentityRecord | None, found: BoardIdentityRecord) -> BoardIdentityRecord:
    """Return what is known of the same board now: what a bad line did not tell this time stays."""
    return replace(kept or found, **{name: value for name, value in asdict(found).items() if value is not None})
