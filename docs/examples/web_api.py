"""A web API of a robot: `uvicorn web_api:app`, then open http://127.0.0.1:8000/docs in a browser.

Whoever reaches the port moves the robot, so leave it on this machine. SERVOLINK_BOARD is the address of the board.
"""

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from fastapi import FastAPI, Request  # pyright: ignore[reportMissingImports]
from fastapi.middleware.trustedhost import TrustedHostMiddleware  # pyright: ignore[reportMissingImports]
from fastapi.responses import JSONResponse  # pyright: ignore[reportMissingImports]
from pydantic import BaseModel  # pyright: ignore[reportMissingImports]

import servolink


class Movement(BaseModel):
    """Where servos go, in degrees by id, and how fast at most, in degrees per second."""

    targets: dict[int, float]
    speed: float = 45


@asynccontextmanager
async def connected(app: FastAPI) -> AsyncIterator[None]:
    """Keep one connection as long as the server runs; it comes back after a loss."""
    board = os.environ.get("SERVOLINK_BOARD", "virtual://")
    async with servolink.connect(board, speed_cap=90, reconnect=True) as app.state.board:
        yield


app = FastAPI(title="Robot", lifespan=connected)
app.add_middleware(TrustedHostMiddleware, allowed_hosts=["localhost", "127.0.0.1"])  # not from pages of other sites


@app.exception_handler(servolink.ServolinkError)
async def tell(request: Request, error: Exception) -> JSONResponse:
    """Tell why something was refused or has failed."""
    return JSONResponse({"error": str(error)}, status_code=409)


@app.get("/servos")
async def servos(request: Request) -> list[dict[str, Any]]:
    """Return where all servos are."""
    found = await request.app.state.board.servos()
    return [{"servo": servo.servo_id, "angle": int(servo.angle), "state": servo.state} for servo in found]


@app.post("/move")
async def move(request: Request, movement: Movement) -> dict[str, float]:
    """Move servos together, and return the seconds until they are there."""
    return {"seconds": await request.app.state.board.move(movement.targets, speed=movement.speed)}


@app.post("/stop")
async def stop(request: Request) -> dict[str, str]:
    """Stop all servos; they hold, and ignore movements until they are started."""
    await request.app.state.board.stop()
    return {"state": "stopped"}
