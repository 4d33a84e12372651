"""Robot on a servolink board: degrees in, degrees out, kept to the limits of the board's profile."""

import time
from typing import Any

from lerobot.cameras.utils import make_cameras_from_configs  # pyright: ignore[reportMissingImports]
from lerobot.motors import MotorCalibration  # pyright: ignore[reportMissingImports]
from lerobot.robots import Robot  # pyright: ignore[reportMissingImports]

import servolink.sync

from .config_servolink import ServolinkConfig

GAP = 2.0
"""Seconds without an action after which the next action begins another stream; servos keep their targets meanwhile."""
_HZ = 100.0  # of the stream, above that of LeRobot's loop, so that `send_action` never waits
_WIDEST = (-180.0, 180.0)  # degrees, for servos without limits


def key_of(servo_id: int) -> str:
    """Return the name of a servo in observations and actions."""
    return f"servo_{servo_id}.pos"


class Streaming:
    """Part of a robot or an arm that turns its servos with set-points."""

    _board: Any = None
    _stream: Any = None
    _sent_at = 0.0

    def _send(self, targets: dict[int, float]) -> dict[int, float]:
        """Turn servos toward targets in degrees by id, as far as limits and caps allow, and return what was sent."""
        now = time.monotonic()
        if self._stream is None or now - self._sent_at > GAP:
            self._stream = self._board.stream(_HZ, gap=2 * GAP)
        self._sent_at = now
        sent: dict[int, float] = self._stream.send(targets)
        return targets | sent

    def _start(self, servo_ids: list[int]) -> None:
        """Let servos hold and obey; each stays where it is."""
        for servo_id in servo_ids:
            if self._board.servo(servo_id).state != "ready":
                self._board.set_servo(servo_id, start=True, hold=True)
        self._stream = None


class Servolink(Robot, Streaming):  # type: ignore[misc,unused-ignore]
    """Robot whose actions are set-points of a stream, which the library clips to limits and speed caps."""

    config_class = ServolinkConfig
    name = "servolink"

    def __init__(self, config: ServolinkConfig) -> None:
        """Open nothing yet."""
        super().__init__(config)
        self.config = config
        self.cameras: dict[str, Any] = make_cameras_from_configs(config.cameras)

    @property
    def _angles(self) -> dict[str, type]:
        return {key_of(servo_id): float for servo_id in self.config.servos}

    @property
    def observation_features(self) -> dict[str, Any]:
        """Angles in degrees, and the pictures of the cameras."""
        pictures = {name: (camera.height, camera.width, 3) for name, camera in self.config.cameras.items()}
        return {**self._angles, **pictures}

    @property
    def action_features(self) -> dict[str, Any]:
        """Angles in degrees."""
        return dict(self._angles)

    @property
    def is_connected(self) -> bool:
        """Whether the board is open."""
        return self._board is not None

    @property
    def is_calibrated(self) -> bool:
        """Always true: angles are degrees, and limits and corrections are those of the profile and of the board."""
        return True

    def connect(self, calibrate: bool = True) -> None:  # noqa: FBT001, FBT002 - as LeRobot calls it
        """Open the board and the cameras, and start the servos at their present angles."""
        self._board = servolink.sync.connect(self.config.board, speed_cap=self.config.speed_cap)
        self.calibrate()
        self.configure()
        for camera in self.cameras.values():
            camera.connect()

    def calibrate(self) -> None:
        """Take the limits of the profile as LeRobot's ranges."""
        self.calibration = {}
        for servo_id in self.config.servos:
            low, high = self._board.limits.of(servo_id) or _WIDEST
            self.calibration[f"servo_{servo_id}"] = MotorCalibration(servo_id, 0, 0, round(low), round(high))

    def configure(self) -> None:
        """Let the servos hold and obey; each stays where it is."""
        self._start(self.config.servos)

    def get_observation(self) -> dict[str, Any]:
        """Return the present angles and pictures."""
        angles = {key_of(servo.servo_id): float(servo.angle) for servo in self._board.servos()}
        pictures = {name: camera.read_latest() for name, camera in self.cameras.items()}
        return {**{key: angles[key] for key in self._angles}, **pictures}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Turn the servos toward an action, as far as limits and caps allow, and return what was sent.

        Raise RequestRefused after a stop: connect again when the robot may move.
        """
        targets = {servo_id: float(action[key_of(servo_id)]) for servo_id in self.config.servos}  # perhaps tensors
        return {key_of(servo_id): float(angle) for servo_id, angle in self._send(targets).items()}

    def disconnect(self) -> None:
        """Close board and cameras; the servos hold their angles."""
        board, self._board = self._board, None
        for camera in self.cameras.values():
            camera.disconnect()
        if board is not None:
            board.close()
