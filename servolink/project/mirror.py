"""Mirroring of actions and macros: exchange of left and right."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from msgspec import UNSET, Struct
from msgspec.structs import replace

from servolink.errors import ProjectError
from servolink.project.figure import Axis, Figure, Joint, Vector
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import dependency_order, free_id, with_caption, with_id, with_records
from servolink.protocol import MACRO, Action, Macro, Record, RecordType, ServoParameter, Step

_OTHER = {"left": "right", "right": "left", "l": "r", "r": "l", "左": "右", "右": "左"}

# A single letter is a side if no letter stands beside it (`L`, `l_knee`, `knee-R`, `L2`), or if capitals separate the
# words (`LKnee`, `kneeL`).
_SIDE = re.compile(
    r"(?i:left|right)|[左右]|(?<![^\W\d_])[LRlr](?![^\W\d_])|(?<![^\W\d_])[LR](?=[A-Z][a-z])|(?<=[a-z])[LR](?![^\W\d_])"
)
_GIVE_PAIRS = "give the pairs, as in 1=2,3=4"


def other_side(caption: str) -> str:
    """Return `caption` with left and right exchanged, unchanged for a caption without a side."""
    return _SIDE.sub(lambda found: _with_case_of(found[0], _OTHER[found[0].lower()]), caption)


def _with_case_of(model: str, word: str) -> str:
    if model.isupper():
        return word.upper()
    return word.capitalize() if model[0].isupper() else word


def partners_by_caption(parameters: Iterable[ServoParameter], servo_ids: Iterable[int]) -> dict[int, int]:
    """Return, in both directions, the partner of each of `servo_ids` with a side in the caption.

    Raise ProjectError for a missing partner, and for several possible partners.
    """
    captions: dict[int, str] = {}
    servos_of = defaultdict[str, set[int]](set)
    for one in parameters:
        captions[one.servo_id] = one.servo_caption
        servos_of[_normalized(one.servo_caption)].add(one.servo_id)
    partners: dict[int, int] = {}
    for servo_id in servo_ids:
        caption = captions.get(servo_id, "")
        if (other := other_side(caption)) == caption:
            continue
        servos, opposite = servos_of[_normalized(caption)], servos_of[_normalized(other)]
        if len(servos) != 1:
            raise ProjectError(f"{len(servos)} servos have the caption '{caption}'; {_GIVE_PAIRS}")
        if len(opposite) != 1:
            found = f"{len(opposite) or 'no'} servo{'s have' if opposite else ' has'} the caption '{other}'"
            raise ProjectError(f"servo {servo_id} has the caption '{caption}', and {found}; {_GIVE_PAIRS}")
        (partner,) = opposite
        partners[servo_id], partners[partner] = partner, servo_id
    return partners


def _normalized(caption: str) -> str:
    return " ".join(caption.casefold().split())


_MOST_NEGATIVE = -0x8000


@dataclass(frozen=True, slots=True)
class Mirror:
    """Mapping of servos to their mirror images, and the directions of rotation."""

    partners: Mapping[int, int]
    """Servo id to servo id, in both directions. A servo that is its own partner gets the opposite angle; a servo
    without a partner keeps the same angle."""
    same_sign: Collection[int] = ()
    """Servos with the same angle as the partner; either servo of a pair is enough. All other servos get the opposite
    angle, because a servo mounted as the mirror image of another turns the other way."""

    class ServoImage(Struct, frozen=True):
        """Mirror image of a servo: another servo, or the same one for a head or a waist."""

        servo: int
        factor: int
        """1 or -1: the image has `factor` times the angle plus `offset`."""
        offset: float
        """Degrees."""
        is_right: bool = False
        """Whether the servo itself is on the right, so that its image is on the left."""

    @staticmethod
    def images(figure: Figure | None, captions: Mapping[int, str]) -> dict[int, Mirror.ServoImage]:
        """Return the image of each servo by servo id: by the limbs of a figure with two sides, otherwise by captions.

        `captions` are by servo id. A servo with several possible images, or without one, is left out.
        """
        return (_images_by_figure(figure) if figure is not None else {}) or _images_by_caption(captions)

    def step(self, step: Step) -> Step:
        """Return the mirror image of a step. Raise ProjectError for -32768, as the opposite does not fit a step."""
        if (partner := self.partners.get(step.servo_id)) is None:
            return step
        if partner in self.same_sign or step.servo_id in self.same_sign:
            return Step(partner, step.degree, step.interval)
        if step.degree == _MOST_NEGATIVE:
            raise ProjectError(f"servo {step.servo_id}: the opposite of {step.degree} does not fit a step")
        return Step(partner, -step.degree, step.interval)


def _images_by_figure(figure: Figure) -> dict[int, Mirror.ServoImage]:
    names = {group: other_names.get("en", "") for group, other_names in figure.groups.items()}
    turned = [joint for joint in figure.joints if joint.servo is not UNSET]
    found: dict[int, Mirror.ServoImage] = {}
    for group, name in names.items():
        opposite = next((key for key, other in names.items() if other == other_side(name) != name), None)
        facing = [joint for joint in turned if opposite is not None and joint.group == opposite]
        by_id = {joint.id: joint for joint in facing}
        for at, joint in enumerate(one for one in turned if one.group == group):
            partner = by_id.get(other_side(joint.id), facing[at] if at < len(facing) else None)
            if partner is not None:
                found |= _image_of(joint, partner, is_right=_is_right(name))
    for joint in turned if found else ():
        if joint.servo not in found:
            found |= _image_of(joint, joint, is_right=False)
    return found


def _image_of(joint: Joint, image: Joint, *, is_right: bool) -> dict[int, Mirror.ServoImage]:
    """Return the image of a joint: a turn about the axis from side to side stays, other turns are reversed."""
    (x, y, z), (a, b, c) = _direction(joint.axis), _direction(image.axis)
    way = image.sign if x * a - y * b - z * c >= 0 else -image.sign
    offset = way * joint.offset - image.sign * image.offset
    return {joint.servo or 0: Mirror.ServoImage(image.servo or 0, way * joint.sign, offset, is_right)}


def _direction(axis: Axis | Vector) -> Vector:
    return (float(axis == "x"), float(axis == "y"), float(axis == "z")) if isinstance(axis, str) else axis


def _images_by_caption(captions: Mapping[int, str]) -> dict[int, Mirror.ServoImage]:
    servos_of = defaultdict[str, list[int]](list)
    for servo_id, caption in captions.items():
        servos_of[_normalized(caption)].append(servo_id)
    found: dict[int, Mirror.ServoImage] = {}
    for servo_id, caption in captions.items():
        other = other_side(caption)
        partners = servos_of.get(_normalized(other), [])
        if other != caption and len(partners) == 1 == len(servos_of[_normalized(caption)]):
            found[servo_id] = Mirror.ServoImage(partners[0], -1, 0, _is_right(caption))
    return found


def _is_right(name: str) -> bool:
    side = _SIDE.search(name)
    return side is not None and side[0].lower() in ("right", "r", "右")


def mirror_by_captions(project: Project, records: Iterable[Record], same_sign: Collection[int] = ()) -> Mirror:
    """Return the mirror for `records` by the captions of their servos. Raise ProjectError if no mirror fits."""
    servo_ids = {servo_id for record in records for servo_id in project.servos_used(record)}
    partners = partners_by_caption(project.servo_parameters, sorted(servo_ids))
    if not partners:
        raise ProjectError(
            f"none of the servos has a caption with left or right; give servos captions, or {_GIVE_PAIRS}"
        )
    return Mirror(partners, same_sign)


def mirror_project(project: Project, records: Iterable[Record], mirror: Mirror) -> tuple[Project, list[str]]:
    """Return `project` with the mirror images of `records` and of all records run, and the list of changes.

    An image already present is not added again, and a symmetric record has no image. Raise ProjectError for a missing
    or endless record.
    """
    imaging = _Imaging(project, mirror)
    records = list(records)
    for macro_id in _macros_to_image(project, records):
        imaging.image(MACRO, macro_id)  # inner macros first: macros may nest deeper than Python calls
    for record in records:
        kind = RecordType.of(record)
        if imaging.image(kind, kind.id_of(record)) == kind.id_of(record):
            imaging.changes.append(f"{name_of(record)} looks the same in the mirror: nothing added")
    return imaging.project(), imaging.changes


def _macros_to_image(project: Project, records: Iterable[Record]) -> list[int]:
    """Return the ids of the macros among `records` and of all macros run by `records`, inner macros first."""
    macros = MACRO.by_id(project)
    stored = [macros.get(one.macro_id, one) if isinstance(one, Macro) else one for one in records]
    found = {one.macro_id for one in project.with_dependencies(stored) if isinstance(one, Macro)} & macros.keys()
    order = dependency_order(macros)
    if endless := sorted(found.difference(order)):
        raise ProjectError(f"{name_of(macros[endless[0]])} never ends: the macro runs itself or an endless macro")
    return [macro_id for macro_id in order if macro_id in found]


class _Imaging:
    """Adds the mirror images of records, and of all records run, to a project."""

    def __init__(self, project: Project, mirror: Mirror) -> None:
        self.changes: list[str] = []
        self._before = project
        self._mirror = mirror
        self._records = project.by_type()
        self._images: dict[tuple[str, int], int] = {}

    def project(self) -> Project:
        return with_records(self._before, self._records)

    def image(self, kind: RecordType[Any], record_id: int) -> int:
        """Return the id of a record's image: a symmetric record is the image of itself."""
        key = kind.field, record_id
        if key not in self._images:
            self._images[key] = self._make_image(kind, record_id)
        return self._images[key]

    def _make_image(self, kind: RecordType[Any], record_id: int) -> int:
        shelf = self._records[kind.field]
        if (record := shelf.get(record_id)) is None:
            raise ProjectError(f"there is no {kind} {record_id}")
        image = self._mirrored(record)
        if image == record:
            return record_id
        caption = other_side(kind.caption_of(record))
        if caption == kind.caption_of(record):
            caption = f"{caption} mirrored"
        image = with_caption(image, caption)
        for other_id, other in shelf.items():
            if with_id(other, record_id) == image:
                self.changes.append(f"{name_of(record)} already has an image: {name_of(other)}")
                return other_id
        new_id = free_id(shelf)
        shelf[new_id] = with_id(image, new_id)
        self.changes.append(f"{name_of(record)} mirrored as {name_of(shelf[new_id])}")
        return new_id

    def _mirrored(self, record: Any) -> Any:
        """Return `record` with mirrored steps, or with references to mirrored records."""
        if isinstance(record, Action):
            steps = tuple(map(self._mirror.step, record.steps))
            return record if set(steps) == set(record.steps) else replace(record, steps=steps)
        return RecordType.of(record).with_references(
            record, lambda kind, called: self.image(kind, called) if called else 0
        )
