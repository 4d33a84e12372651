"""Boards whose answers are odd: what they leave out, count wrongly, or measure differently."""

from __future__ import annotations

from servolink.virtual.odd.board import ALL, OddBoard, OddServo
from servolink.virtual.odd.wire import NAMES, Values


def _from(*starts: str) -> frozenset[str]:
    """Return the names of requests whose packet ids begin with one of `starts`."""
    return frozenset(name for packet_id, name in NAMES.items() if str(packet_id).startswith(starts))


class WithoutProjectId(OddBoard, name="no-project-id"):
    """It does not answer the query of the project id."""

    lesson = "a missing query is left out, with one line that says so"
    ignored = frozenset({"QueryProjectID"})


class OldFirmware(OddBoard, name="old-firmware"):
    """It has servos, actions and macros, but neither memory size, power, project id nor joystick tables."""

    lesson = "queries that settle earlier ones are chosen from what the board answers"
    ignored = _from("10030", "10040", "30120", "30130", "400")


class ServosOnly(OddBoard, name="servos-only"):
    """It answers only the mode setting and the requests for servos."""

    lesson = "servos move without stored records"
    ignored = _from("10020", "10030", "10040", "30", "40")


class Refusing(OddBoard, name="refusing"):
    """It has no servos and no records, and refuses all that is to be stored."""

    lesson = "an empty board is usable, and says that it has no servos"
    servo_ids = ()

    def __init__(self) -> None:
        super().__init__()
        self.active_table = 0
        self.parameters.clear()
        for stored in self.records.values():
            stored.clear()

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        """Refuse."""
        return 0

    def write_project_id(self, values: Values) -> Values:
        """Refuse."""
        return {"result": 0}


class FromZero(OddBoard, name="from-zero"):
    """Its servos have the ids 0 to 3."""

    lesson = "0 is an id where the board lists it"
    servo_ids = (0, 1, 2, 3)


class OneServo(OddBoard, name="one-servo"):
    """It has a single servo, with the id 7."""

    lesson = "a response for all servos may look like a response for one"
    servo_ids = (7,)


class ManyServos(OddBoard, name="many-servos"):
    """It has 254 servos."""

    lesson = "responses of 3 KB are read at once"
    servo_ids = range(1, 255)


class Big5Captions(OddBoard, name="big5"):
    """Its captions are Big5."""

    lesson = "the encoding is learnt from the captions"
    encoding = "big5"


class GbkCaptions(OddBoard, name="gbk"):
    """Its captions are GBK."""

    lesson = "the encoding is learnt from the captions"
    encoding = "gbk"
    captions = ("挥手", "鞠躬", "前进", "左手")


class SpacedCaptions(OddBoard, name="spaced"):
    """Its captions are padded with spaces."""

    lesson = "padding with spaces is shown as it is"

    def caption(self, text: str) -> bytes:
        """Return a caption with spaces behind it."""
        return text.encode(self.encoding).ljust(32, b" ")


class UnclearedCaptions(OddBoard, name="uncleared"):
    """Behind the end of its captions are the remains of its memory."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"

    def caption(self, text: str) -> bytes:
        """Return a caption with rubbish behind it."""
        return (text.encode(self.encoding) + b"\0" + bytes(range(0xC8, 0xE8)))[:32]


class UnclearedBig5(UnclearedCaptions, name="uncleared-big5"):
    """Its captions are Big5, with the remains of its memory behind them."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"
    encoding = "big5"


class UnclearedGbk(UnclearedCaptions, name="uncleared-gbk"):
    """Its captions are GBK, with the remains of its memory behind them."""

    lesson = "bytes behind the end of a caption are ignored, in learning too"
    encoding = "gbk"
    captions = ("挥手", "鞠躬", "前进", "左手")


class Full(OddBoard, name="full"):
    """Its memory is full."""

    lesson = "a refused record is named, and nothing else is changed"
    memory = 250


class InKib(OddBoard, name="kib"):
    """It reports memory in KiB."""

    lesson = "memory has no unit until the unit is learnt, and units are not added up"
    unit = 1024

    def memory_size(self, values: Values) -> Values:
        """Return free and total memory in units."""
        return {key: size // self.unit for key, size in super().memory_size(values).items()}


class InPercent(InKib, name="percent"):
    """It reports memory in percent."""

    lesson = "a unit that is neither bytes nor KiB stays unknown"
    unit = OddBoard.memory // 100


class FreeOnly(OddBoard, name="free-only"):
    """It reports free memory without the total, as the length in the document says."""

    lesson = "the total is unknown, and nothing fails"

    def content(self, packet_id: int, values: Values) -> bytes:
        """Return the content, cut for the memory size."""
        content = super().content(packet_id, values)
        return content[:4] if packet_id == 10031 else content


class NotMeasured(OddBoard, name="not-measured"):
    """It reports -1 for memory and power."""

    lesson = "-1 is shown as not measured, and is not learnt"

    def memory_size(self, values: Values) -> Values:
        """Return -1 for both."""
        return {"size": -1, "totalSize": -1}

    def remaining_power(self, values: Values) -> Values:
        """Return -1."""
        return {"permil": -1}


class Clipping(OddBoard, name="clipping"):
    """It stores angles of at most 30°, and says that it has stored the record."""

    lesson = "records are read back after writing, and differences are named"

    def store(self, stored: dict[int, Values], record_id: int, values: Values) -> int:
        """Store the record with its angles cut."""
        for step in values.get("steps", ()):
            step["degree"] = max(-30, min(30, step["degree"]))
        return super().store(stored, record_id, values)


class MissingServo(OddBoard, name="missing-servo"):
    """It lists four servos, and returns three states for all of them."""

    lesson = "both counts are shown"

    def servo_states(self, values: Values) -> Values:
        """Return the states without the last of all."""
        found = super().servo_states(values)
        if values["servoID"] == ALL:
            found = {"servoCount": len(found["servos"]) - 1, "servos": found["servos"][:-1]}
        return found


class WrongCount(OddBoard, name="wrong-count"):
    """The count in its list of servo ids is one too high."""

    lesson = "a response that contradicts itself is named as such, not as a missing one"

    def servo_list(self, values: Values) -> Values:
        """Return the list with a wrong count."""
        found = super().servo_list(values)
        return {**found, "servoCount": found["servoCount"] + 1}


class SinglesOnly(OddBoard, name="singles-only"):
    """It returns no state when all servos are asked for, and takes all other requests for all of them."""

    lesson = "servos are read one by one where all at once are not answered"

    def servo_states(self, values: Values) -> Values:
        """Return the states of a single servo only."""
        return super().servo_states(values) if values["servoID"] != ALL else {"servoCount": 0, "servos": []}


class WithoutAll(OddBoard, name="no-all"):
    """It ignores every request for all servos."""

    lesson = "stop, release and angle unit go to each servo too, and a stop is confirmed by reading"

    def answer(self, packet_id: int, values: Values) -> Values | None:
        """Return no response, and do nothing, if all servos are addressed."""
        return None if values.get("servoID") == ALL else super().answer(packet_id, values)


class AdcOnly(OddBoard, name="adc-only"):
    """Its angles are raw ADC; it answers the setting of degrees with the unit in use."""

    lesson = "angles are shown as ADC, with the reason"

    def __init__(self) -> None:
        super().__init__()
        for servo in self.servos.values():
            servo.unit = 1

    def set_unit(self, values: Values) -> Values:
        """Leave the unit as it is."""
        return {**values, "unitType": 1}


class HalfProjectId(OddBoard, name="half-project-id"):
    """It stores 16 bits of the project id."""

    lesson = "the mark of an unfinished import is recognised by what is left of it"

    def write_project_id(self, values: Values) -> Values:
        """Store the lower half."""
        return super().write_project_id({"projectID": values["projectID"] & 0xFFFF})


class WithoutFeedback(OddBoard, name="no-feedback"):
    """It reports the commanded angle at once, as boards with plain servos do."""

    lesson = "a movement that takes no time is not a measurement"

    def move(self, servo: OddServo, step: Values) -> None:
        """Report the goal from now on."""
        super().move(servo, {**step, "interval": 0})
