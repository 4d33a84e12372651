"""Metrics of a fleet, for Prometheus; nothing is commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.gateways.metrics.exposition import serve_metrics as serve_metrics
else:
    _MODULES = {"exposition": ("serve_metrics",)}
    __all__ = ["serve_metrics"]
    __getattr__ = lazy_names(__name__, _MODULES, extra="metrics")
