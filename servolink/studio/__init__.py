"""Studio: page on this machine in which people pose, build, try and save a robot (docs/design/studio.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.studio.fleet_view import FleetView as FleetView
    from servolink.studio.links import Links as Links
    from servolink.studio.server import serve_studio as serve_studio
    from servolink.studio.start import opened_in_browser as opened_in_browser
    from servolink.studio.start import studio_for as studio_for
    from servolink.studio.static_files import page_files as page_files
else:
    _MODULES = {
        # studio
        "server": ("serve_studio",),
        "start": (
            "opened_in_browser",
            "studio_for",
        ),
        "links": ("Links",),
        "fleet_view": ("FleetView",),
        "static_files": ("page_files",),
    }
    __all__ = [name for names in _MODULES.values() for name in names]
    __getattr__ = lazy_names(__name__, _MODULES, extra="studio")
