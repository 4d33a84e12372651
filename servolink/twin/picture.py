"""Picture of a moment of a trial, drawn by MuJoCo without a screen."""

from __future__ import annotations

import multiprocessing
import os
import struct
import zlib
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final

from servolink.errors import TwinError, escape
from servolink.project import Project
from servolink.protocol import Action, Macro
from servolink.twin.body import Body
from servolink.twin.simulation import Physics, mujoco
from servolink.twin.trial import Variation, start

SIZE: Final = (640, 480)
"""Width and height of a picture, in pixels."""

_WAYS = ("egl", "osmesa", "")  # values of MUJOCO_GL: without a screen, in software, and what the system has
_DISTANCE = 5.0  # of the camera, for each metre from the centre of the robot to the farthest part
_PATIENCE = 60.0  # seconds


def draw(project: Project, body: Body, record: Action | Macro, variation: Variation, seconds: float) -> bytes:
    """Return a PNG of the robot at a moment of a run. Raise TwinError if this computer cannot draw."""
    failures = []
    for way in _WAYS:
        # A process for each way: MuJoCo chooses once, and a broken driver ends the process that draws.
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _choose, (way,)) as executor:
            try:
                return executor.submit(_draw, project, body, record, variation, seconds).result(_PATIENCE)
            except Exception as error:  # noqa: BLE001 - each driver has errors of its own
                failures.append(f"{way or 'the system'}: {str(error) or type(error).__name__}")
    raise TwinError(
        f"nothing was drawn, as this computer has neither EGL nor OSMesa ({escape('; '.join(failures))}); "
        "on Debian and Ubuntu: apt install libegl1 libosmesa6"
    )


def _choose(way: str) -> None:
    if way:
        os.environ["MUJOCO_GL"] = way


def _draw(project: Project, body: Body, record: Action | Macro, variation: Variation, seconds: float) -> bytes:
    physics = Physics(body)
    start(physics, project, record, variation).advance(seconds)
    module = mujoco()
    camera = module.MjvCamera()
    camera.lookat[:] = physics.data.subtree_com[1]
    reach = abs(physics.data.xpos[1:] - physics.data.subtree_com[1]).max()
    camera.distance, camera.azimuth, camera.elevation = _DISTANCE * reach, 150, -12
    with module.Renderer(physics.model, height=SIZE[1], width=SIZE[0]) as renderer:
        renderer.update_scene(physics.data, camera)
        return png(renderer.render())


def png(pixels: Any) -> bytes:
    """Return an image of height, width and three colours, an array of bytes, as PNG."""
    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, content) for name, content in chunks)


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
