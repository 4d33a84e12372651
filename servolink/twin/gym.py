"""Gymnasium environment: the body of a project, turned by an agent in place of a board.

Importing this module registers `servolink/Twin-v0` with Gymnasium.
"""

from __future__ import annotations

import math
import os
from typing import Any, Final

from servolink.errors import TwinError, install_extra
from servolink.twin.body import Body
from servolink.twin.mjcf import BASE
from servolink.twin.simulation import STEP, Physics

try:
    import gymnasium  # pyright: ignore[reportMissingImports]
    import numpy as np
except ImportError as error:
    raise TwinError(f"the environment needs Gymnasium; {install_extra('gym')} ({error})") from error

ID: Final = "servolink/Twin-v0"
"""Id of the environment."""
FRAME: Final = 0.02
"""Simulated seconds of a step of the environment."""
LONGEST: Final = 500
"""Steps of an episode; Gymnasium then truncates it."""
FALLEN: Final = 45.0
"""Lean of the base in degrees at which the robot has fallen, and the episode ends."""

_SHAKE = math.radians(2)  # largest angle by which a servo differs from rest at the start
_FASTEST = 50.0  # rad/s and m/s: the bound of observed speeds
_STEPS = round(FRAME / STEP)


class TwinEnvironment(gymnasium.Env[Any, Any]):  # type: ignore[misc,unused-ignore]  # without Gymnasium it is Any
    """Robot of a project, with a servo for each action.

    An action has a value for each servo, in the order of `servo_ids`, from -1 for the lowest angle of the limits to 1
    for the highest. An observation has the angles of the servos on the same scale, the speeds of the servos (rad/s),
    the direction of up in the frame of the base, the height of the base (m), and the turning (rad/s) and speed (m/s) of
    the base. The reward is 1 for each step; derive a class with another `reward` for another task.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1 / FRAME)}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, project: str | os.PathLike[str], render_mode: None = None) -> None:
        """Take the robot of a project file.

        Raises:
            ProjectError: The file cannot be read.
            TwinError: The figure has no possible body or no servo, or MuJoCo is missing.
        """
        self.physics = Physics(Body.read(project)[1])
        self.servo_ids = self.physics.servo_ids
        """Servo of each value of an action."""
        self.render_mode = render_mode
        if not self.servo_ids:
            raise TwinError(f"{os.fspath(project)}: no servo turns a part of the figure")
        model, count = self.physics.model, len(self.servo_ids)
        joints = model.actuator_trnid[:, 0]
        self._low, high = model.jnt_range[joints].T
        self._span = (high - self._low) / 2
        self._speeds = model.jnt_dofadr[joints]
        self._base = model.body(BASE).id
        bounds = np.concatenate(
            [np.full(count, 1.5), np.full(count, _FASTEST), np.ones(3), [100], np.full(6, _FASTEST)]
        )
        self._bounds = bounds.astype(np.float32)
        self.action_space = gymnasium.spaces.Box(-1, 1, (count,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-self._bounds, self._bounds, dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Put the robot at rest, with each servo up to 2 degrees from there; the same seed gives the same episode."""
        super().reset(seed=seed)
        self.physics.reset()
        data = self.physics.data
        shaken = data.ctrl + self.np_random.uniform(-_SHAKE, _SHAKE, len(self.servo_ids))
        data.ctrl[:] = np.clip(shaken, self._low, self._low + 2 * self._span)
        data.qpos[self.physics.positions] = data.ctrl
        self.physics.advance(1)
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Turn the servos towards the angles of an action for 20 ms."""
        data = self.physics.data
        data.ctrl[:] = self._low + (np.clip(action, -1, 1) + 1) * self._span
        self.physics.advance(_STEPS)
        has_fallen = bool(data.xmat[self._base, 8] < math.cos(math.radians(FALLEN)))
        return self._observation(), self.reward(), has_fallen, False, {}

    def reward(self) -> float:
        """Return the reward of the step just made."""
        return 1.0

    def _observation(self) -> Any:
        data, physics = self.physics.data, self.physics
        angles = (data.qpos[physics.positions] - self._low) / self._span - 1
        up, height = data.xmat[self._base, 6:], data.xpos[self._base, 2:]
        seen = np.concatenate([angles, data.qvel[self._speeds], up, height, data.cvel[self._base]], dtype=np.float32)
        return np.clip(seen, -self._bounds, self._bounds)


gymnasium.register(ID, f"{__name__}:{TwinEnvironment.__name__}", max_episode_steps=LONGEST)
