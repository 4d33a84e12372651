"""How much is tried: more on a build server than by whoever waits for the tests."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

MANY = 10 if os.environ.get("CI") else 1
MUTATIONS = 200 * MANY
"""Mutated inputs of a target with a share of 1."""


def examples(count: int) -> settings:
    """Return settings with so many examples for one who waits."""
    return settings(max_examples=count * MANY, suppress_health_check=[HealthCheck.function_scoped_fixture])
