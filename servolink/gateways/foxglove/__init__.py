"""Foxglove: live channels of a hub or of a recording, and targets published there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.gateways.foxglove.live_channels import LiveChannels as LiveChannels
    from servolink.gateways.foxglove.live_channels import convert as convert
    from servolink.gateways.foxglove.live_channels import written_to as written_to
    from servolink.gateways.foxglove.live_server import PublishedTargets as PublishedTargets
    from servolink.gateways.foxglove.live_server import serving as serving
else:
    _MODULES = {
        # channels
        "live_channels": (
            "LiveChannels",
            "convert",
            "written_to",
        ),
        # the server
        "live_server": (
            "PublishedTargets",
            "serving",
        ),
    }
    __all__ = [name for names in _MODULES.values() for name in names]
    __getattr__ = lazy_names(__name__, _MODULES, extra="foxglove")
