"""The end of the demo: from one board into a file, and from there into another board, cable or not."""

from __future__ import annotations

import argparse
import asyncio
import math
import shlex
import shutil
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from servolink.cli.demo_stage import FaultyLine, JsonStage, Outcome, Scene, Stage, TextStage
from servolink.cli.live import PHASES
from servolink.cli.main import FAILED, OK
from servolink.cli.output import Table
from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.terminal import cleanup
from servolink.client.connect import connect
from servolink.errors import ConnectionLost, RequestTimeout, ServolinkError
from servolink.listeners import AVAILABLE
from servolink.project.project_file import load_project, save_project
from servolink.project.transfer.results import Progress
from servolink.protocol.records import (
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    ServoParameter,
    Step,
)
from servolink.protocol.servos import ALL_SERVOS, QueryServoRequest
from servolink.transports.registry import create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve

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
            await board.apply_project(load_project(_file(scene)), folder=scene.folder, on_progress=tell)
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
        applied = await board.apply_project(load_project(_file(scene)), folder=scene.folder)
        scene.stage.say("the same import again: it goes on where it was, and reads the whole board twice at the end")
        plan = await board.plan_project(load_project(_file(scene)))
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


_BOW, _LEAN, _RISE, _WAVE, _PAD, _BUTTON = 1, 2, 3, 1, 1, 3  # ids on the board
_IMPATIENT = 0.3  # seconds for an answer on the bad line
_TOO_LATE = 0.6
_REACTION = 2.0  # seconds in which a button event must have come


async def show_servos(scene: Scene) -> Outcome:
    """List the servos."""
    servos = await scene.board.servos()
    scene.stage.say(f"connected to {scene.board.url}")
    rows = [(servo.servo_id, servo.angle, servo.current, servo.temperature) for servo in servos]
    scene.stage.table(Table(("servo", "angle", "current (raw)", "temperature (raw)"), rows))
    return Outcome(
        {"url": scene.board.url, "servos": len(servos), "round_trip_seconds": scene.board.stats.round_trip(50)},
        {
            f"all {len(scene.virtual.servos)} servos answered": len(servos) == len(scene.virtual.servos),
            "their angles are the board's": {servo.servo_id: int(servo.angle) for servo in servos} == _angles(scene),
        },
    )


async def move_pose(scene: Scene) -> Outcome:
    """Move all servos at once and watch them."""
    pose = {servo_id: round(90 * math.sin(servo_id / 16 * 2 * math.pi)) for servo_id in scene.virtual.servos}
    asked = 1.5 * scene.pace
    took = await scene.board.move(pose, duration=asked)
    seconds = await scene.watch(pose, took)
    return Outcome(
        {"targets": pose, "asked_seconds": asked, "seconds": seconds},
        {
            "every servo arrived": _angles(scene) == pose,
            "none was early": seconds >= asked,
        },
    )


async def run_action(scene: Scene) -> Outcome:
    """Store an action and run it."""
    bow = _pose(scene, _BOW, "Bow", lambda servo_id: 60 if servo_id % 2 else -60)
    await scene.board.add_action(bow)
    stored = await scene.board.action(_BOW)
    scene.stage.say(
        f"stored and read back: action {stored.action_id} '{stored.action_caption}', {len(stored.steps)} steps"
    )
    await scene.board.run_action(_BOW)
    seconds = await scene.watch(_targets(bow), bow.steps[0].interval / 100)
    return Outcome(
        {"action_id": _BOW, "steps": len(bow.steps), "seconds": seconds},
        {
            "the action reads back as it was written": stored == bow,
            "running it moved every servo there": _angles(scene) == _targets(bow),
        },
    )


async def run_macro(scene: Scene) -> Outcome:
    """Store a macro of two actions and run it."""
    lean = _pose(scene, _LEAN, "Lean", lambda servo_id: round(75 * math.cos(servo_id / 16 * 2 * math.pi)))
    rise = _pose(scene, _RISE, "Rise", lambda servo_id: -servo_id * 5)
    pause = MacroCommand(10 * scene.interval(0.1), MacroCommandType.DELAY)
    wave = Macro(_WAVE, "Wave", (MacroCommand(_LEAN), pause, MacroCommand(_RISE, ratio=80)))
    await scene.board.add_action(lean)
    await scene.board.add_action(rise)
    await scene.board.add_macro(wave)
    stored = await scene.board.macro(_WAVE)
    scene.stage.say(f"stored and read back: macro {_WAVE} 'Wave': lean, wait, rise at 80 % speed")
    await scene.board.run_macro(_WAVE)
    seconds = await scene.watch(_targets(rise), _wave_seconds(scene))
    return Outcome(
        {"macro_id": _WAVE, "commands": len(wave.commands), "seconds": seconds},
        {
            "the macro reads back as it was written": stored == wave,
            "it ended in its last pose": _angles(scene) == _targets(rise),
        },
    )


async def press_button(scene: Scene) -> Outcome:
    """Store a joystick table, press a button, and see its event and its macro."""
    loop = asyncio.get_running_loop()
    table = JoystickTable(_PAD, "Pad", (Button(_BUTTON, "Wave", button_press_macro=_WAVE),))
    await scene.board.add_joystick_table(table)
    await scene.board.set_active_joystick_table(_PAD)
    async with scene.board.button_events() as events:
        pressed = loop.time()
        scene.virtual.press_button(_BUTTON, pressed)
        started = scene.virtual.player.macro_id == _WAVE
        async with asyncio.timeout(_REACTION):
            event = await anext(events)
        latency = loop.time() - pressed
        scene.virtual.release_button(_BUTTON, loop.time())
        async with asyncio.timeout(_REACTION):
            released = await anext(events)
        scene.stage.say(f"button {event.button_id}: {event.kind}, {latency * 1000:.1f} ms after it went down")
        rise = await scene.board.action(_RISE)
        await scene.watch(_targets(rise), _wave_seconds(scene))
    return Outcome(
        {"button_id": event.button_id, "events": [event.kind, released.kind], "event_seconds": round(latency, 6)},
        {
            f"button {_BUTTON} sent press and up": [event.kind, released.kind] == ["press", "up"]
            and event.button_id == released.button_id == _BUTTON,
            "the board started the button's macro, which ended in its last pose": started
            and _angles(scene) == _targets(rise),
        },
    )


async def survive_damage(scene: Scene) -> Outcome:
    """Damage a byte of one reply."""
    before, damaged = scene.counters(), scene.line.damaged
    scene.line.damage_next()
    scene.stage.say("one bit of the next reply is changed on the line; then all angles are read")
    reply = await scene.board.request(QueryServoRequest(ALL_SERVOS), timeout=_IMPATIENT)
    since = scene.counted(before)
    return Outcome(
        {"damaged_replies": scene.line.damaged - damaged, **since},
        {
            "exactly one reply was damaged": scene.line.damaged - damaged == 1,
            "the damaged reply was thrown away and asked for again": since["skipped_bytes"] > 0
            and since["retries"] > 0,
            "the angles are right": {state.servo_id: state.angle for state in reply.servos} == _angles(scene),
        },
    )


async def survive_delay(scene: Scene) -> Outcome:
    """Let one reply come after its time, when the right answer has become another one."""
    before, delayed = scene.counters(), scene.line.delayed
    old = _angles(scene)
    scene.stage.say(
        f"servo 1 is at {old[1]}°; all angles are read, and the reply is held back until nobody waits for it"
    )
    scene.line.delay_next(_TOO_LATE)
    try:
        await scene.board.request(QueryServoRequest(ALL_SERVOS), timeout=_IMPATIENT, retries=0)
        timed_out = False
    except RequestTimeout:
        timed_out = True
    await scene.board.move(dict.fromkeys(old, 0), duration=0.01)
    scene.stage.say("all servos go to 0°, and all angles are read again, while the old reply is still to come")
    answer = {servo.servo_id: int(servo.angle) for servo in await scene.board.servos()}
    since = scene.counted(before)
    return Outcome(
        {"delayed_replies": scene.line.delayed - delayed, "late_angle": old[1], "angle": answer[1], **since},
        {
            "exactly one reply was delayed past its time": timed_out and scene.line.delayed - delayed == 1,
            "a fence showed the late reply to be late": since["late_responses"] > 0 and since["fences"] > 0,
            f"servo 1 is read at {answer[1]}°, and all angles are right": answer == _angles(scene) != old,
        },
    )


STEPS: tuple[tuple[str, str, Callable[[Scene], Awaitable[Outcome]]], ...] = (
    ("servos", "A board with 16 servos, read over a serial port", show_servos),
    ("pose", "All servos move at once", move_pose),
    ("action", "An action, stored on the board and run", run_action),
    ("macro", "A macro, stored on the board and run", run_macro),
    ("button", "A joystick button that starts the macro", press_button),
    ("damaged", "A damaged reply", survive_damage),
    ("late", "A late reply", survive_delay),
    ("export", "Everything on the board, as a project file", export_project),
    ("pulled", "The project into a second board, whose cable is pulled", pull_cable),
    ("resumed", "Plugged in again", finish_import),
)
"""Name, title and play of each step."""


def _angles(scene: Scene) -> dict[int, int]:
    """Return the angles that the virtual board really has."""
    return {servo_id: round(servo.angle) for servo_id, servo in scene.virtual.servos.items()}


def _pose(scene: Scene, action_id: int, caption: str, angle_of: Callable[[int], int]) -> Action:
    interval = scene.interval(0.7)
    return Action(
        action_id, caption, tuple(Step(servo_id, angle_of(servo_id), interval) for servo_id in scene.virtual.servos)
    )


def _targets(action: Action) -> dict[int, int]:
    return {step.servo_id: step.degree for step in action.steps}


def _wave_seconds(scene: Scene) -> float:
    move, pause = scene.interval(0.7), scene.interval(0.1)
    return (move + pause + move / 0.8) / 100


_SERVOS = 16
_FAST = 0.05


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink demo`."""
    parser.set_defaults(run=run)
    parser.add_argument("--fast", action="store_true", help="do the same with quick movements and no time to read")


def run(args: argparse.Namespace) -> int:
    """Play all steps: 0, or 1 if a check failed."""
    stage: Stage = JsonStage() if args.json else TextStage(fast=args.fast)

    async def main(interruption: Interruption) -> int:
        return await _play(stage, _FAST if args.fast else 1.0)

    return run_interruptible(main, "only the demo's own virtual board was moved")


async def _play(stage: Stage, pace: float) -> int:
    start = asyncio.get_running_loop().time()
    virtual, second = VirtualBoard(_SERVOS, seed=1), VirtualBoard(_SERVOS, seed=2)
    folder = tempfile.mkdtemp(prefix="servolink-demo-")
    with cleanup(partial(shutil.rmtree, folder, ignore_errors=True)):
        async with _served(virtual) as url, _served(second) as second_url:
            line = FaultyLine(create(url))
            async with connect(line) as board:
                scene = Scene(board, virtual, line, second, second_url, stage, Path(folder), pace)
                failed = await _steps(scene)
                stats = board.stats.as_dict()
    seconds = round(asyncio.get_running_loop().time() - start, 3)
    stage.end({"ok": not failed, "failed": failed, "seconds": seconds, "next": _next_commands(), "stats": stats})
    return FAILED if failed else OK


@asynccontextmanager
async def _served(board: VirtualBoard) -> AsyncIterator[str]:
    """Serve `board` over what a board is usually connected by; yield its address."""
    async with serve(board, pty=AVAILABLE, tcp=None if AVAILABLE else "127.0.0.1:0") as (url,):
        yield url


async def _steps(scene: Scene) -> list[str]:
    """Play the steps and return those that failed; an error ends the play."""
    failed: list[str] = []
    for name, title, play in STEPS:
        scene.stage.begin(title)
        try:
            outcome = await play(scene)
        except (ServolinkError, TimeoutError) as error:
            reason = str(error) or "nothing came in time"
            await scene.stage.finish(name, Outcome({"error": reason}, {reason: False}))
            return [*failed, name]
        await scene.stage.finish(name, outcome)
        if not outcome.ok:
            failed.append(name)
    return failed


def _next_commands() -> list[str]:
    """Return commands that work when they are pasted, wherever this one was started from."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    servolink = own_name()
    return [
        f"{servolink} virtual --tcp {place}",
        f"{servolink} --url tcp://{place} servos",
        f"{servolink} --url tcp://{place} move 1=60 2=-30 --speed 45",
    ]


def own_name() -> str:
    """Return how this program was called."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m servolink"
    found = shutil.which("servolink")
    return "servolink" if found and Path(found).resolve() == called.resolve() else shlex.quote(str(called))
