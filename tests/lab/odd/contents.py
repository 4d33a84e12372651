"""Boards with odd responses: missing, miscounted, or in other units."""

from __future__ import annotations

from tests.lab.odd.board import ALL, OddBoard, OddServo
from tests.lab.odd.wire import NAMES, Values


def _from(*starts: str) -> frozenset[str]:
    """Return the names of requests whose packet ids begin with one of `starts`."""
    return frozenset(name for packet_id, name in NAMES.items() if str(packet_id).startswith(starts))


class WithoutProjectId(OddBoard, name="no-project-id"):
    """No response to the query of the project id."""

    lesson = "a missing query is left out and reported in one line"
    ignored = frozenset({"QueryProjectID"})


class OldFirmware(OddBoard, name="old-firmware"):
    """Servos, actions and macros, without memory size, power, project id and joystick tables."""

    lesson = "fences are chosen among the answered queries"
    ignored = _from("10030", "10040", "30120", "30130", "400")


class ServosOnly(OddBoard, name="servos-only"):
    """Responses to the mode setting and the requests for servos only."""

    lesson = "servos move without stored records"
    ignored = _from("10020", "10030", "10040", "30", "40")


class Refusing(OddBoard, name="refusing"):
    """Empty board without servos; refuses every record."""

    lesson = "an empty board is usable"
    servo_ids = ()

    def __init__(self) -> None:
        super().__init__()
        self.active_table = 0
        self.parameters.clear()
        for stored in self.records.values():
            stored.clear()

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        return 0

    def write_project_id(self, values: Values) -> Values:
        return {"result": 0}


class FromZero(OddBoard, name="from-zero"):
    """Servos with the ids 0 to 3."""

    lesson = "0 is a valid id on a board with a servo 0"
    servo_ids = (0, 1, 2, 3)


class OneServo(OddBoard, name="one-servo"):
    """Single servo, with the id 7."""

    lesson = "a response for all servos may look like a response for one"
    servo_ids = (7,)


class ManyServos(OddBoard, name="many-servos"):
    """Servos with the ids 1 to 254."""

    lesson = "responses of 3 KB are read at once"
    servo_ids = range(1, 255)


class Big5Captions(OddBoard, name="big5"):
    """Captions in the encoding Big5."""

    lesson = "the encoding is learnt from the captions"
    encoding = "big5"


class GbkCaptions(OddBoard, name="gbk"):
    """Captions in the encoding GBK."""

    lesson = "the encoding is learnt from the captions"
    encoding = "gbk"
    captions = ("挥手", "鞠躬", "前进", "左手")


class SpacedCaptions(OddBoard, name="spaced"):
    """Captions padded with spaces, without zeros."""

    lesson = "padding with spaces is shown unchanged"

    def caption(self, text: str) -> bytes:
        return text.encode(self.encoding).ljust(32, b" ")


class UnclearedCaptions(OddBoard, name="uncleared"):
    """Captions with random bytes behind the end."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"

    def caption(self, text: str) -> bytes:
        return (text.encode(self.encoding) + b"\0" + bytes(range(0xC8, 0xE8)))[:32]


class UnclearedBig5(UnclearedCaptions, name="uncleared-big5"):
    """Captions in Big5, with random bytes behind the end."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"
    encoding = "big5"


class UnclearedGbk(UnclearedCaptions, name="uncleared-gbk"):
    """Captions in GBK, with random bytes behind the end."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"
    encoding = "gbk"
    captions = ("挥手", "鞠躬", "前进", "左手")


class Full(OddBoard, name="full"):
    """Memory without room for another record."""

    lesson = "a refused record is named, and nothing else is changed"
    memory = 250


class InKib(OddBoard, name="kib"):
    """Free and total memory in KiB."""

    lesson = "memory has no unit before the unit is learnt, and sizes in unknown units are not added up"
    unit = 1024

    def memory_size(self, values: Values) -> Values:
        return {key: size // self.unit for key, size in super().memory_size(values).items()}


class InPercent(InKib, name="percent"):
    """Free and total memory in percent."""

    lesson = "a unit other than bytes and KiB stays unknown"
    unit = OddBoard.memory // 100  # which makes the total 100


class FreeOnly(OddBoard, name="free-only"):
    """Free memory without the total, by the length in the document."""

    lesson = "the total is unknown, and nothing fails"

    def content(self, packet_id: int, values: Values) -> bytes:
        content = super().content(packet_id, values)
        return content[:4] if packet_id == 10031 else content


class NotMeasured(OddBoard, name="not-measured"):
    """Memory sizes and power of -1."""

    lesson = "-1 is shown as not measured, and never learnt"

    def memory_size(self, values: Values) -> Values:
        return {"size": -1, "totalSize": -1}

    def remaining_power(self, values: Values) -> Values:
        return {"permil": -1}


class Clipping(OddBoard, name="clipping"):
    """Stored angles cut to 30°, with the result "stored"."""

    lesson = "records are read back after writing, and differences are named"

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        for step in values.get("steps", ()):
            step["degree"] = max(-30, min(30, step["degree"]))
        return super().store(stored, record_id, values)


class MissingServo(OddBoard, name="missing-servo"):
    """List of four servos, and three states in the response for all servos."""

    lesson = "servos that the response for all leaves out are asked singly"

    def servo_states(self, values: Values) -> Values:
        found = super().servo_states(values)
        if values["servoID"] == ALL:
            found = {"servoCount": len(found["servos"]) - 1, "servos": found["servos"][:-1]}
        return found


class WrongCount(OddBoard, name="wrong-count"):
    """List of servo ids with a count one too high."""

    lesson = "a contradictory response is reported as contradictory, not as missing"

    def servo_list(self, values: Values) -> Values:
        found = super().servo_list(values)
        return {**found, "servoCount": found["servoCount"] + 1}


class SinglesOnly(OddBoard, name="singles-only"):
    """No states in the response for all servos; other requests for all servos are executed."""

    lesson = "servos are read one by one on boards without a response for all"

    def servo_states(self, values: Values) -> Values:
        return super().servo_states(values) if values["servoID"] != ALL else {"servoCount": 0, "servos": []}


class WithoutAll(OddBoard, name="no-all"):
    """Requests for all servos are ignored."""

    lesson = "stop, release and angle unit are also sent to each servo, and a stop is confirmed by reading"

    def answer(self, packet_id: int, values: Values) -> Values | None:
        return None if values.get("servoID") == ALL else super().answer(packet_id, values)


class AdcOnly(OddBoard, name="adc-only"):
    """Angles in raw ADC; the response to the setting of degrees names ADC."""

    lesson = "angles are shown as ADC, with the reason"

    def __init__(self) -> None:
        super().__init__()
        for servo in self.servos.values():
            servo.unit = 1

    def set_unit(self, values: Values) -> Values:
        return {**values, "unitType": 1}


class HalfProjectId(OddBoard, name="half-project-id"):
    """Stored project id of 16 bits."""

    lesson = "the marker of an unfinished import is recognised by its lower half"

    def write_project_id(self, values: Values) -> Values:
        return super().write_project_id({"projectID": values["projectID"] & 0xFFFF})


class WithoutFeedback(OddBoard, name="no-feedback"):
    """Commanded angle reported immediately, as by boards with plain servos."""

    lesson = "a movement without duration is not a measurement"

    def move(self, servo: OddServo, step: Values) -> None:
        super().move(servo, {**step, "interval": 0})
