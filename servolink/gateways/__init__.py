"""Doors for other protocols: `models`, `foxglove`, `ros` and `metrics`; each is a program of a hub, or of a fleet."""

from __future__ import annotations

from servolink.gateways.supervisor import Supervisor, supervised

__all__ = ["Supervisor", "supervised"]
