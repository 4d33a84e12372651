"""Leader arm on a servolink board: a person turns its released servos, after LeRobot has brought it to the robot."""

from typing import Any

from lerobot.teleoperators import Teleoperator  # pyright: ignore[reportMissingImports]

import servolink.sync

from .config_servolink import ServolinkLeaderConfig
from .robot import Streaming, key_of


class ServolinkLeader(Teleoperator, Streaming):  # type: ignore[misc,unused-ignore]
    """Leader arm whose angles are the actions of a robot."""

    config_class = ServolinkLeaderConfig
    name = "servolink_leader"

    def __init__(self, config: ServolinkLeaderConfig) -> None:
        """Open nothing yet."""
        super().__init__(config)
        self.config = config
        self._keys = dict(zip(config.servos, map(key_of, config.follower or config.servos), strict=True))
        self._holds = False

    @property
    def action_features(self) -> dict[str, Any]:
        """Angles in degrees, by the names of the robot's servos."""
        return dict.fromkeys(self._keys.values(), float)

    @property
    def feedback_features(self) -> dict[str, Any]:
        """Angles in degrees, by the names of the robot's servos; none if the arm may not move."""
        return dict(self.action_features) if self.config.may_move else {}

    @property
    def is_connected(self) -> bool:
        """Whether the board is open."""
        return self._board is not None

    @property
    def is_calibrated(self) -> bool:
        """Always true, as for the robot."""
        return True

    def connect(self, calibrate: bool = True) -> None:  # noqa: FBT001, FBT002 - as LeRobot calls it
        """Open the board and release the servos. A raised arm falls: hold it."""
        self._board = servolink.sync.connect(self.config.board, speed_cap=self.config.speed_cap)
        self.configure()

    def calibrate(self) -> None:
        """Do nothing: angles are degrees."""

    def configure(self) -> None:
        """Release the servos."""
        self.disable_torque()

    def enable_torque(self) -> None:
        """Let the servos hold where they are, so that `send_feedback` turns them. Raise PermissionError if off."""
        if not self.config.may_move:
            raise PermissionError("the leader arm may not move; --teleop.may_move=true allows it")
        self._start(self.config.servos)
        self._holds = True

    def disable_torque(self) -> None:
        """Release the servos for a person. A raised arm falls: hold it."""
        self._holds = False
        for servo_id in self._keys:
            self._board.release(servo_id)

    def get_action(self) -> dict[str, Any]:
        """Return the present angles."""
        angles = {servo.servo_id: float(servo.angle) for servo in self._board.servos()}
        return {key: angles[servo_id] for servo_id, key in self._keys.items()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Turn the servos toward the robot's angles while they hold; released ones are left to the person.

        Raise RequestRefused after a stop.
        """
        if self._holds:
            self._send({servo: float(feedback[key]) for servo, key in self._keys.items() if key in feedback})

    def disconnect(self) -> None:
        """Close the board; the servos stay released, or hold where LeRobot has turned them."""
        board, self._board = self._board, None
        if board is not None:
            board.close()
