"""Leader arm on a servolink board: its servos are released, and a person turns them."""

from typing import Any

from lerobot.teleoperators import Teleoperator  # pyright: ignore[reportMissingImports]

import servolink.sync

from .config_servolink import ServolinkLeaderConfig
from .robot import key_of


class ServolinkLeader(Teleoperator):  # type: ignore[misc,unused-ignore]
    """Leader arm whose angles are the actions of a robot."""

    config_class = ServolinkLeaderConfig
    name = "servolink_leader"

    def __init__(self, config: ServolinkLeaderConfig) -> None:
        """Open nothing yet."""
        super().__init__(config)
        self.config = config
        self._board: Any = None
        self._keys = dict(zip(config.servos, map(key_of, config.follower or config.servos), strict=True))

    @property
    def action_features(self) -> dict[str, Any]:
        """Angles in degrees, by the names of the robot's servos."""
        return dict.fromkeys(self._keys.values(), float)

    @property
    def feedback_features(self) -> dict[str, Any]:
        """None: released servos cannot push back."""
        return {}

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
        self._board = servolink.sync.connect(self.config.board)
        self.configure()

    def calibrate(self) -> None:
        """Do nothing: angles are degrees."""

    def configure(self) -> None:
        """Release the servos."""
        for servo_id in self._keys:
            self._board.release(servo_id)

    def get_action(self) -> dict[str, Any]:
        """Return the present angles."""
        angles = {servo.servo_id: float(servo.angle) for servo in self._board.servos()}
        return {key: angles[servo_id] for servo_id, key in self._keys.items()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: released servos cannot push back."""

    def disconnect(self) -> None:
        """Close the board; the servos stay released."""
        board, self._board = self._board, None
        if board is not None:
            board.close()
