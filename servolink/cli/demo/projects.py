"""The end of the demo: from one board into a file, and from there into another board, cable or not."""

from __future__ import annotations

from pathlib import Path

from servolink.cli.demo.line import FaultyLine
from servolink.cli.demo.scene import Scene
from servolink.cli.demo.stage import Outcome
from servolink.cli.progress import PHASES
from servolink.client.connect import connect
from servolink.errors import ConnectionLost
from servolink.project.files.file import load_project, save_project
from servolink.project.imports.progress import Progress
from servolink.protocol.editing import ServoParameter
from servolink.transports.registry import create

_PROJECT = 42


async def export_project(scene: Scene) -> Outcome:
    """Write everything on the board into a file."""
    await scene.board.write_project_id(_PROJECT)
    await scene.board.add_servo_parameters([ServoParameter(1, servo_caption="left arm")])
    project = await scene.board.export_project()
    save_project(_file(scene), project)
    scene.stage.say(f"{_file(scene)}: {len(project.actions)} actions, each part read twice; the first lines:")
    for line in _file(scene).read_text(encoding="utf-8").splitlines()[:9]:
        scene.stage.say(f"   {line}")
    return Outcome(
        {"file": str(_file(scene)), "actions": len(project.actions), "macros": len(project.macros)},
        {"the file holds what is on the board": load_project(_file(scene)) == project},
    )


async def pull_cable(scene: Scene) -> Outcome:
    """Begin to write the file to a second board, and pull the cable in the middle."""
    line = FaultyLine(create(scene.second_url))
    reached: list[Progress] = []

    def tell(progress: Progress) -> None:
        reached.append(progress)
        if progress.phase == "writing" and progress.done * 2 >= progress.total:
            line.pull()

    lost = ""
    try:
        async with connect(line) as board:
            await board.apply(load_project(_file(scene)), folder=scene.folder, progress=tell)
    except ConnectionLost as error:
        lost = str(error)
    scene.stage.say(f"pulled while {PHASES[reached[-1].phase]}, at {reached[-1].item}: {lost}")
    async with connect(scene.second_url) as board:
        unfinished = await board.has_unfinished_import()
    return Outcome(
        {"at": reached[-1].item, "done": reached[-1].done, "total": reached[-1].total},
        {"the import ended in the middle": bool(lost), "the board itself says that it is unfinished": unfinished},
    )


async def finish_import(scene: Scene) -> Outcome:
    """Go on with the import, and compare."""
    async with connect(scene.second_url) as board:
        applied = await board.apply(load_project(_file(scene)), folder=scene.folder)
        scene.stage.say("the same import again: it goes on where it was, and reads the whole board twice at the end")
        plan = await board.plan(load_project(_file(scene)))
        scene.stage.say(f"plan: {len(plan.changes)} differences")
    return Outcome(
        {"differences": len(plan.changes), "backup": str(applied.backup)},
        {
            "it went on": applied.resumed,
            "0 differences": not plan.changes,
            "both virtual boards store the same": scene.second.storage.contents == scene.virtual.storage.contents,
        },
    )


def _file(scene: Scene) -> Path:
    return scene.folder / "demo.servolink.json"
