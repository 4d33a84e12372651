"""Language models, by the Model Context Protocol, as one more program of a hub."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.gateways.models.model_serving import serve_on_http as serve_on_http
    from servolink.gateways.models.model_serving import serve_on_stdio as serve_on_stdio
    from servolink.gateways.models.model_tools import ModelTools as ModelTools
else:
    _MODULES = {
        # the server
        "model_serving": (
            "serve_on_http",
            "serve_on_stdio",
        ),
        "model_tools": ("ModelTools",),
    }
    __all__ = [name for names in _MODULES.values() for name in names]
    __getattr__ = lazy_names(__name__, _MODULES, extra="mcp")
