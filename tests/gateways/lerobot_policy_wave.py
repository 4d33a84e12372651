"""Policy for LeRobot that is a script: the first joint waves about where it was, and all others stay.

LeRobot looks for the parts of a policy by their names, all in this module. `python -m lerobot_policy_wave FOLDER COUNT`
saves one for COUNT joints as LeRobot saves trained ones; `python -m lerobot_policy_wave FOLDER` prints the frames of a
data set as JSON.
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from lerobot.configs import FeatureType, NormalizationMode, PolicyFeature, PreTrainedConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.processor import make_default_pre_post_processors
from lerobot.utils.constants import ACTION, OBS_STATE

FPS = 30
PERIOD = 3.0
"""Seconds of a wave."""
register: Any = PreTrainedConfig.register_subclass("wave")


@register
@dataclass
class WaveConfig(PreTrainedConfig):  # type: ignore[misc,unused-ignore]
    """Settings that all policies have."""

    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: dict.fromkeys(("STATE", "ACTION"), NormalizationMode.IDENTITY)
    )
    observation_delta_indices = action_delta_indices = reward_delta_indices = None

    def get_optimizer_preset(self) -> Any:
        """Refuse to be trained."""
        raise RuntimeError("the wave is written, not learnt: it cannot be trained")

    get_scheduler_preset = validate_features = get_optimizer_preset


class WavePolicy(PreTrainedPolicy):  # type: ignore[misc,unused-ignore]
    """Policy without knowledge, but a height in degrees."""

    config_class = WaveConfig
    name = "wave"

    def __init__(self, config: WaveConfig, **options: Any) -> None:
        super().__init__(config)
        self.height = torch.nn.Parameter(torch.tensor(20.0))
        self.reset()

    def reset(self) -> None:
        """Wave about the next place."""
        self._begun: Any = None
        self._turn = 0

    def select_action(self, batch: dict[str, Any], **options: Any) -> Any:
        """Return the angles of the next turn."""
        self._begun = batch[OBS_STATE] if self._begun is None else self._begun
        self._turn += 1
        way = torch.zeros_like(self._begun)
        way[..., 0] = self.height * math.sin(math.tau * self._turn / FPS / PERIOD)
        return self._begun + way

    def forward(self, batch: dict[str, Any]) -> Any:
        """Refuse to be trained."""
        raise RuntimeError("the wave is written, not learnt: it cannot be trained")

    get_optim_params = predict_action_chunk = forward


def make_wave_pre_post_processors(config: WaveConfig, dataset_stats: Any = None) -> Any:
    """Return what LeRobot does before and after the policy: nothing to the numbers."""
    return make_default_pre_post_processors(config, dataset_stats)


def save(folder: Path, count: int) -> None:
    """Save a policy for a number of joints."""
    inputs = {OBS_STATE: PolicyFeature(FeatureType.STATE, (count,))}
    config = WaveConfig(device="cpu", input_features=inputs)
    config.output_features = {ACTION: PolicyFeature(FeatureType.ACTION, (count,))}
    for part in (WavePolicy(config), *make_wave_pre_post_processors(config)):
        part.save_pretrained(folder)


def show(folder: Path) -> None:
    """Print state, action and mark of each frame of a data set."""
    from lerobot.datasets import LeRobotDataset

    frames = LeRobotDataset("servolink/rollout_trial", root=folder)
    numbers = [[frame[OBS_STATE].tolist(), frame[ACTION].tolist(), bool(frame["intervention"])] for frame in frames]
    print(json.dumps(numbers))


if __name__ == "__main__":
    save(Path(sys.argv[1]), int(sys.argv[2])) if sys.argv[2:] else show(Path(sys.argv[1]))
