"""What an import would do, and cost; nothing is changed to find out."""

from __future__ import annotations

import asyncio

from servolink.project.imports.apply import check_writable
from servolink.project.imports.compare import compare
from servolink.project.imports.cost import Cost, cost_of_marking, cost_of_reading, cost_of_writing
from servolink.project.imports.journal import is_unfinished
from servolink.project.imports.progress import Tell
from servolink.project.imports.read import Asked, Content, read_content
from servolink.project.imports.results import Plan
from servolink.project.imports.writes import Write, writes
from servolink.project.model import Project
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest


async def plan_project(
    board: Asked, project: Project, *, tell: Tell, replace: bool = False, exact: bool = False
) -> Plan:
    """Return what `apply_project` would do; ProjectError for a project that cannot be written to any board."""
    check_writable(board, project, exact=exact)
    loop = asyncio.get_running_loop()
    begun = loop.time()
    content = await read_content(board, tell)
    taken = loop.time() - begun
    memory = await board.request(QueryMemorySizeRequest())
    here = content.readable()
    reading = cost_of_reading(here)
    changes = compare(here, project)
    faults = (
        *(f"{name} is listed more than once" for name in content.doubled()),
        *(f"{name} is listed and not given" for name in content.missing()),
    )
    cost = _cost(board, content, project, replace=replace) if changes or faults else Cost()
    return Plan(
        changes,
        faults,
        cost.requests,
        cost.wire_bytes,
        round(cost.requests * taken / reading.requests, 3),
        memory.total_size,
        memory.size,
        memory.size - content.growth(project),
        is_unfinished(content.project_id),
    )


def _cost(board: Asked, content: Content, project: Project, *, replace: bool) -> Cost:
    codec = board.codec
    around = cost_of_reading(content.readable()) + cost_of_marking(2) + cost_of_reading(project.sorted())
    if not replace:
        return around + cost_of_writing(writes(content, project), codec)
    clearing = Write("everything", ClearAllDataRequest())
    cleared = cost_of_reading(Project()) + cost_of_marking(1)
    return around + cost_of_writing([clearing, *writes(Content(), project)], codec) + cleared
