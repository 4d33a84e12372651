"""The environment for learning: Gymnasium's own checker, seeds, many robots at once, and falls.

Module: servolink.twin.gym.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servolink.errors import TwinError
from servolink.project import Figure, Project, save_project
from tests.twin.figures import DEMO, LIMB, figure

MAKE = "servolink.twin.gym:servolink/Twin-v0"


@pytest.fixture
def gymnasium() -> Any:
    return pytest.importorskip("gymnasium", reason="in the extra gym")


def test_gymnasium_finds_no_fault(gymnasium: Any) -> None:
    checker = importlib.import_module("gymnasium.utils.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gymnasium.make(MAKE, project=DEMO).unwrapped)


def test_the_same_seed_gives_the_same_episode(gymnasium: Any) -> None:
    def episode(seed: int) -> Any:
        env = gymnasium.make(MAKE, project=DEMO)
        env.action_space.seed(7)
        seen = [env.reset(seed=seed)[0]]
        return np.array(seen + [env.step(env.action_space.sample())[0] for _ in range(10)])

    assert np.array_equal(episode(1), episode(1))
    assert not np.array_equal(episode(1), episode(2))


def test_a_robot_with_all_servos_at_0_stands_until_it_is_truncated(gymnasium: Any) -> None:
    env = gymnasium.make(MAKE, project=DEMO)
    env.reset(seed=3)
    limits = [part.limits for part, _ in env.unwrapped.physics.body.drives.values()]
    standing = np.array([-2 * low / (high - low) - 1 for low, high in limits])
    ends = [env.step(standing)[2:4] for _ in range(500)]
    assert ends[-1] == (False, True)
    assert ends[:-1] == [(False, False)] * 499


def test_a_robot_that_throws_its_legs_up_falls(gymnasium: Any) -> None:
    env = gymnasium.make(MAKE, project=DEMO)
    env.reset(seed=3)
    thrown = np.ones(16)
    assert any(env.step(thrown)[2] for _ in range(150))


def test_many_robots_step_together(gymnasium: Any) -> None:
    many = gymnasium.make_vec(MAKE, num_envs=3, vectorization_mode="sync", project=DEMO)
    first, _ = many.reset(seed=5)
    assert first.shape == (3, 42)
    assert many.step(many.action_space.sample())[1].tolist() == [1, 1, 1]
    assert not np.array_equal(first[0], first[1])


def test_a_project_without_servos_is_refused(gymnasium: Any, tmp_path: Path) -> None:
    path = tmp_path / "plate.json"
    save(path, figure({"id": "plate", "shapes": [LIMB]}))
    with pytest.raises(TwinError, match=r"plate\.json: no servo turns a part"):
        gymnasium.make(MAKE, project=path)


def test_without_gymnasium_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "servolink.twin.gym", raising=False)
    with pytest.raises(TwinError, match=r"the environment needs Gymnasium; .*'\.\[gym\]'"):
        importlib.import_module("servolink.twin.gym")


def save(path: Path, shape: Figure) -> None:
    save_project(path, Project(), figure=shape)
