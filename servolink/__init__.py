"""servolink: drive a servo control board from asyncio, the shell, or with no board at all.

async with servolink.connect("virtual://?servos=16") as board:
    print(await board.servos())
    await board.move({1: 120, 2: 60}, duration=0.5, wait=True)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servolink.api import *  # noqa: F403
else:
    # Loaded when the first name is used: the command line starts without most of it. `from servolink import api`
    # would ask `__getattr__` for `api` again.
    from importlib import import_module

    def __getattr__(name: str) -> object:
        api = import_module("servolink.api")
        if name == "__all__" or name in api.__all__:
            return getattr(api, name)
        raise AttributeError(f"module 'servolink' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *import_module("servolink.api").__all__})
