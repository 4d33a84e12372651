"""How many inputs are tried: more on a build server than on a developer's machine."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

MANY = 3 if os.environ.get("CI") else 1
MUTATIONS = 100 * MANY
"""The number of mutated inputs for a target with a share of 1."""


def examples(count: int) -> settings:
    """Return settings with `count` examples on a developer's machine, and more on a build server."""
    return settings(max_examples=count * MANY, suppress_health_check=[HealthCheck.function_scoped_fixture])
