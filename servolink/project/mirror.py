"""Left and right exchanged: the other half of a humanoid's moves, for free."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project
from servolink.project.records import by_kind, free_id, named, with_id, with_records
from servolink.protocol.record_types import Record, RecordType, type_of
from servolink.protocol.records import Action, ServoParameter, Step

_OTHER = {"left": "right", "right": "left", "l": "r", "r": "l", "左": "右", "右": "左"}

# A letter is a side where no letter stands beside it (`L`, `l_knee`, `knee-R`, `L2`), or where capitals tell the words
# apart (`LKnee`, `kneeL`).
_SIDE = re.compile(
    r"(?i:left|right)|[左右]|(?<![^\W\d_])[LRlr](?![^\W\d_])|(?<![^\W\d_])[LR](?=[A-Z][a-z])|(?<=[a-z])[LR](?![^\W\d_])"
)
_BY_HAND = "give the pairs, as in 1=2,3=4"


def other_side(caption: str) -> str:
    """Return `caption` with left and right exchanged; the same if it names no side."""
    return _SIDE.sub(lambda found: _written_like(found[0], _OTHER[found[0].lower()]), caption)


def partners_by_caption(parameters: Iterable[ServoParameter], servo_ids: Iterable[int]) -> dict[int, int]:
    """Return the partner of each of `servo_ids` whose caption names a side, and the partner's partner.

    ProjectError if there is none, or if more than one could be meant.
    """
    captions: dict[int, str] = {}
    called = defaultdict[str, set[int]](set)
    for one in parameters:
        captions[one.servo_id] = one.servo_caption
        called[_spoken(one.servo_caption)].add(one.servo_id)
    partners: dict[int, int] = {}
    for servo_id in servo_ids:
        caption = captions.get(servo_id, "")
        if (other := other_side(caption)) == caption:
            continue
        mine, theirs = called[_spoken(caption)], called[_spoken(other)]
        if len(mine) != 1:
            raise ProjectError(f"{len(mine)} servos are called '{escape(caption)}'; {_BY_HAND}")
        if len(theirs) != 1:
            found = f"{len(theirs) or 'no'} servo{'s are' if theirs else ' is'} called '{escape(other)}'"
            raise ProjectError(f"servo {servo_id} is called '{escape(caption)}', and {found}; {_BY_HAND}")
        (partner,) = theirs
        partners[servo_id], partners[partner] = partner, servo_id
    return partners


def _spoken(caption: str) -> str:
    return " ".join(caption.casefold().split())


def _written_like(model: str, word: str) -> str:
    """Return `word` with the capitals of `model`."""
    if model.isupper():
        return word.upper()
    return word.capitalize() if model[0].isupper() else word


_MOST_NEGATIVE = -0x8000


@dataclass(frozen=True, slots=True)
class Mirror:
    """Which servo is the mirror image of which, and how it turns."""

    partners: Mapping[int, int]
    """In both directions. A servo that is its own partner turns the other way; one without any stays as it is."""
    same_sign: Collection[int] = ()
    """Servos, of which each pair may have one here, that take their partner's angle as it is. The others take the
    opposite angle, as a servo that is built in as the mirror image of another turns the other way round."""

    def step(self, step: Step) -> Step:
        """Return the mirror image of a step; ProjectError for the one angle that has no opposite."""
        if (partner := self.partners.get(step.servo_id)) is None:
            return step
        if partner in self.same_sign or step.servo_id in self.same_sign:
            return Step(partner, step.degree, step.interval)
        if step.degree == _MOST_NEGATIVE:
            raise ProjectError(f"servo {step.servo_id}: {step.degree} has no opposite that fits a step")
        return Step(partner, -step.degree, step.interval)


def mirror_by_captions(project: Project, records: Iterable[Record], same_sign: Collection[int] = ()) -> Mirror:
    """Return the mirror for `records` that the captions of their servos say; ProjectError if they do not."""
    servo_ids = sorted({step.servo_id for action in _actions(project, records) for step in action.steps})
    partners = partners_by_caption(project.servo_parameters, servo_ids)
    if not partners:
        raise ProjectError(
            "no servo in it has a caption that says left or right: name the servos, or give the pairs, as in 1=2,3=4"
        )
    return Mirror(partners, same_sign)


def mirror_project(project: Project, records: Iterable[Record], mirror: Mirror) -> tuple[Project, list[str]]:
    """Return `project` with the mirror images of `records` and of what they call, and what was done.

    An image that is there already is not added again, and what looks the same in the mirror has none.
    """
    imaging = _Imaging(project, mirror)
    for record in records:
        kind = type_of(record)
        if imaging.image(kind, kind.id_of(record)) == kind.id_of(record):
            imaging.said.append(f"{named(record)} looks the same in the mirror: nothing added")
    return imaging.project(), imaging.said


def _actions(project: Project, records: Iterable[Record]) -> Iterable[Action]:
    """Yield the actions that `records` are or call."""
    open_records, seen = list(records), set[int]()
    shelves = by_kind(project)
    while open_records:
        record = open_records.pop()
        if id(record) in seen:
            continue
        seen.add(id(record))
        if isinstance(record, Action):
            yield record
        called = (shelves[kind.field].get(number) for kind, number in type_of(record).references(record))
        open_records += [one for one in called if one is not None]


class _Imaging:
    def __init__(self, project: Project, mirror: Mirror) -> None:
        self.said: list[str] = []
        self._before = project
        self._mirror = mirror
        self._records = by_kind(project)
        self._images: dict[tuple[str, int], int | None] = {}  # None while it is being made

    def project(self) -> Project:
        return with_records(self._before, self._records)

    def image(self, kind: RecordType[Any], record_id: int) -> int:
        """Return the id of a record's image, which is its own if it looks the same."""
        key = kind.field, record_id
        if key not in self._images:
            self._images[key] = None
            self._images[key] = self._made(kind, record_id)
        if (image := self._images[key]) is None:
            raise ProjectError(f"{kind.label} {record_id} runs itself")
        return image

    def _made(self, kind: RecordType[Any], record_id: int) -> int:
        shelf = self._records[kind.field]
        if (record := shelf.get(record_id)) is None:
            raise ProjectError(f"there is no {kind.label} {record_id}")
        image = self._content(record)
        if image == record:
            return record_id
        caption = other_side(kind.caption_of(record))
        if caption == kind.caption_of(record):
            caption = f"{caption} mirrored"
        image = msgspec.structs.replace(image, **{image.__struct_fields__[1]: caption})
        for other_id, other in shelf.items():
            if with_id(other, record_id) == image:
                self.said.append(f"{named(record)} has its image already: {named(other)}")
                return other_id
        new_id = free_id(shelf)
        shelf[new_id] = with_id(image, new_id)
        self.said.append(f"{named(record)} mirrored as {named(shelf[new_id])}")
        return new_id

    def _called_image(self, kind: RecordType[Any], record_id: int) -> int:
        return self.image(kind, record_id) if record_id else 0

    def _content(self, record: Any) -> Any:
        """Return `record` with what it does mirrored."""
        if not isinstance(record, Action):
            return type_of(record).with_references(record, self._called_image)
        steps = tuple(map(self._mirror.step, record.steps))
        return record if set(steps) == set(record.steps) else msgspec.structs.replace(record, steps=steps)
