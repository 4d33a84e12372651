"""A movement of a virtual robot that was seen plays again as a macro, within 50 ms and 2 degrees, in virtual time.

Module: servolink.project.teaching.
"""

from __future__ import annotations

import asyncio

from servolink.client import Board, connect
from servolink.project import PoseRecorder, Project, extend_project
from servolink.virtual import VirtualBoard, VirtualTransport

LATE, OFF, LEAD = 0.05, 2.0, 1.0  # seconds, degrees, seconds
SERVOS = (2, 3)
WAYS = [({2: 60, 3: -20}, 0.8), ({2: 20}, 0.3), ({2: 80, 3: 30}, 0.9), ({3: 0}, 0.5), ({2: 0}, 1.2)]


async def watched(board: Board, seconds: float) -> list[tuple[float, dict[int, float]]]:
    """Return readings of the servos, 50 a second, with their times."""
    now, found = asyncio.get_running_loop().time, []
    end = now() + seconds
    while now() < end:
        found.append((now(), {servo.servo_id: float(servo.angle) for servo in await board.servos()}))
        await asyncio.sleep(0.02)
    return found


async def test_a_movement_that_was_seen_plays_again_within_50_ms_and_2_degrees() -> None:
    async with connect(VirtualTransport(VirtualBoard(servos=4))) as board:
        watching = asyncio.create_task(watched(board, 5.5))
        for targets, duration in WAYS:
            await board.move(targets, duration=duration)
            await asyncio.sleep(duration)
        seen = await watching
        rows = {each: [angles[each] for _, angles in seen] for each in SERVOS}
        recorder, worst = PoseRecorder.thinned([time for time, _ in seen], rows, 1, LEAD)
        assert worst <= 1.5
        assert len(recorder.poses) < len(seen) / 4
        recorder.caption = "Seen"
        project = extend_project(Project(), recorder.record())
        await board.apply_project(project)
        watching = asyncio.create_task(watched(board, 8))
        await board.run_macro(project.macros[0].macro_id)
        played = await watching
    assert min(distance(seen, played, played[0][0] + at / 100) for at in range(50, 180)) <= OFF


def distance(
    seen: list[tuple[float, dict[int, float]]], played: list[tuple[float, dict[int, float]]], start: float
) -> float:
    """Return how far what was played from `start` on is from what was seen, at most, in degrees."""
    worst = 0.0
    for time, angles in seen:
        moment = time - seen[0][0] + start
        near = [other for at, other in played if abs(at - moment) <= LATE]
        worst = max([worst, *(min([abs(one[each] - angles[each]) for one in near], default=999) for each in SERVOS)])
    return worst
