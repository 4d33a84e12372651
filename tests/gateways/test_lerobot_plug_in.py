"""The documentation's plug-in for LeRobot, on base classes with the signatures that LeRobot has.

`tests/data/lerobot.json` is recorded from LeRobot itself, which takes 5 GB; `.ci/release` runs the plug-in there.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import sys
from abc import ABCMeta
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

import servolink
from tests.processes import until

ROOT = Path(__file__).parents[2]
PLUG_IN = ROOT / "docs/examples/lerobot_robot_servolink"
RECORDED: dict[str, Any] = json.loads((ROOT / "tests/data/lerobot.json").read_text())


class Tensor:
    """Number as `lerobot-replay` reads it from a data set."""

    def __init__(self, value: float) -> None:
        self._value = value

    def __float__(self) -> float:
        return self._value


def base_class(name: str, methods: dict[str, Any]) -> type:
    """Return a class with the recorded abstract methods, and with what its `__init__` keeps."""

    def begin(self: Any, config: Any) -> None:
        self.id, self.calibration = config.id, {}

    members: dict[str, Any] = {"__init__": begin}
    for method in methods:
        member: Any = lambda self: None  # noqa: E731 - has a mark of its own
        member.__isabstractmethod__ = True
        members[method] = member
    return ABCMeta(name, (), members)


def config_class(name: str, fields: list[str]) -> type:
    """Return a class of settings that registers others, as those of LeRobot do."""
    made = dataclasses.make_dataclass(name, [(each, Any, None) for each in fields], kw_only=True)
    registered: dict[str, type] = {}

    def register(choice: str) -> Callable[[type], type]:
        return lambda declared: registered.setdefault(choice, declared)

    made.registered, made.register_subclass = registered, staticmethod(register)  # type: ignore[attr-defined]
    return made


@pytest.fixture
def plug_in(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Import the plug-in beside modules that stand in for LeRobot."""
    found: dict[str, Any] = {}
    for name, methods in RECORDED["bases"].items():
        found[name] = base_class(name, methods)
    for name, fields in RECORDED["configs"].items():
        found[name] = config_class(name.rpartition(".")[2], fields)
    for name, fields in RECORDED["calls"].items():
        found[name] = dataclasses.make_dataclass(name.rpartition(".")[2], fields)
    found["lerobot.cameras.utils.make_cameras_from_configs"] = lambda camera_configs: {}
    for name, value in found.items():
        place, _, last = name.rpartition(".")
        for at in range(1, place.count(".") + 2):
            part = ".".join(place.split(".")[:at])
            if part not in sys.modules:
                monkeypatch.setitem(sys.modules, part, ModuleType(part))
        setattr(sys.modules[place], last, value)
    monkeypatch.syspath_prepend(str(PLUG_IN))
    yield pytest.importorskip("lerobot_robot_servolink")
    for loaded in [name for name in sys.modules if name.startswith("lerobot_robot_servolink")]:
        del sys.modules[loaded]


@pytest.mark.parametrize(
    ("name", "base"),
    [("Servolink", "lerobot.robots.Robot"), ("ServolinkLeader", "lerobot.teleoperators.Teleoperator")],
)
def test_the_signatures_are_those_of_lerobot(plug_in: Any, name: str, base: str) -> None:
    declared = getattr(plug_in, name)
    assert inspect.isabstract(declared) is False
    for method, expected in RECORDED["bases"][base].items():
        value = inspect.getattr_static(declared, method)
        found = "property" if isinstance(value, property) else [*inspect.signature(value).parameters]
        assert found == expected, method


def test_lerobot_finds_both_devices(plug_in: Any) -> None:
    assert 'name = "lerobot_robot_servolink"' in (PLUG_IN / "pyproject.toml").read_text()
    for place, choice in (
        ("robots.RobotConfig", "servolink"),
        ("teleoperators.TeleoperatorConfig", "servolink_leader"),
    ):
        module, _, name = place.partition(".")
        config = getattr(sys.modules[f"lerobot.{module}"], name).registered[choice]
        assert config.__name__.removesuffix("Config") in plug_in.__all__  # how LeRobot looks for the device
        assert config.__module__.partition(".")[0] == plug_in.__name__


def test_actions_are_clipped_and_what_was_sent_is_returned(plug_in: Any) -> None:
    robot = plug_in.Servolink(plug_in.ServolinkConfig(board="virtual://?servos=3", servos=[1, 3], speed_cap=60.0))
    assert robot.observation_features == robot.action_features == {"servo_1.pos": float, "servo_3.pos": float}
    assert not robot.is_connected
    robot.connect()
    try:
        assert robot.is_connected
        assert robot.is_calibrated
        assert robot.calibration.keys() == {"servo_1", "servo_3"}
        before = robot.get_observation()
        target = before["servo_1.pos"] + 90
        sent = robot.send_action({"servo_1.pos": Tensor(target), "servo_3.pos": before["servo_3.pos"]})
        assert 0 < sent["servo_1.pos"] - before["servo_1.pos"] < 10  # degrees in a period, and 50 ms
        assert sent["servo_3.pos"] == before["servo_3.pos"]
        robot._board.stop()
        with pytest.raises(servolink.RequestRefused):
            robot.send_action(sent)
    finally:
        robot.disconnect()
    assert not robot.is_connected


def test_a_pause_begins_another_stream(plug_in: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules["lerobot_robot_servolink.robot"]
    now = [0.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    robot = plug_in.Servolink(plug_in.ServolinkConfig(board="virtual://?servos=1", servos=[1]))
    robot.connect()
    try:
        robot._board.stop()
        robot.configure()
        assert robot._board.servo(1).state == "ready"
        here = robot.get_observation()
        robot.send_action(here)
        first = robot._stream
        robot.send_action(here)
        assert robot._stream is first
        now[0] += module.GAP + 1
        robot.send_action(here)
        assert robot._stream is not first
    finally:
        robot.disconnect()


def test_a_leader_arm_is_released_and_names_the_servos_of_its_robot(plug_in: Any) -> None:
    config = plug_in.ServolinkLeaderConfig(board="virtual://?servos=2", servos=[1, 2], follower=[5, 6])
    leader = plug_in.ServolinkLeader(config)
    leader.connect()
    try:
        assert {servo.state for servo in leader._board.servos()} == {"released"}
        assert leader.get_action().keys() == leader.action_features.keys() == {"servo_5.pos", "servo_6.pos"}
        leader.send_feedback({"servo_5.pos": 90.0, "servo_6.pos": 0.0})  # before it may move
        assert {servo.state for servo in leader._board.servos()} == {"released"}
    finally:
        leader.disconnect()


def test_a_leader_arm_goes_to_the_robot_before_a_person_takes_over(plug_in: Any) -> None:
    """What LeRobot's `teleop_supports_feedback` asks, and what its `teleop_smooth_move_to` does."""
    ids = {"servos": [1, 2], "follower": [5, 6]}
    config = plug_in.ServolinkLeaderConfig(board="virtual://?servos=2", **ids, may_move=True)
    leader = plug_in.ServolinkLeader(config)
    assert leader.feedback_features == leader.action_features
    leader.connect()
    try:
        leader.enable_torque()
        assert {servo.state for servo in leader._board.servos()} == {"ready"}
        begun = leader.get_action()
        target = {"servo_5.pos": begun["servo_5.pos"] + 12, "servo_6.pos": begun["servo_6.pos"], "else.pos": 1.0}
        for step in range(21):
            leader.send_feedback({key: begun.get(key, 0) * (1 - step / 20) + target[key] * step / 20 for key in target})
        until(lambda: abs(leader.get_action()["servo_5.pos"] - target["servo_5.pos"]) <= 1)
        leader.disable_torque()
        assert {servo.state for servo in leader._board.servos()} == {"released"}
        leader.send_feedback(begun)
        assert {servo.state for servo in leader._board.servos()} == {"released"}
        leader.enable_torque()
        leader._board.stop()
        with pytest.raises(servolink.RequestRefused):
            leader.send_feedback(begun)
    finally:
        leader.disconnect()


def test_a_leader_arm_that_may_not_move_is_never_turned(plug_in: Any) -> None:
    config = plug_in.ServolinkLeaderConfig(board="virtual://?servos=1", servos=[1])
    leader = plug_in.ServolinkLeader(config)
    assert leader.feedback_features == {}
    leader.connect()
    try:
        with pytest.raises(PermissionError, match="may_move"):
            leader.enable_torque()
        assert leader._board.servo(1).state == "released"
    finally:
        leader.disconnect()
