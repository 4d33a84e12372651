"""`servolink demo`: move, edit and disturb a virtual board, and copy the content to another board."""

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

from servolink.cli.command import FIRST_STEPS, Command, flag
from servolink.cli.command_session import Interruption, run_interruptible
from servolink.cli.first_steps.demo_stage import FaultyLine, Scene, Stage, StageResult
from servolink.cli.screen.live import PHASES
from servolink.cli.screen.output import Table
from servolink.cli.screen.terminal import cleanup
from servolink.cli.usage import refuse_board
from servolink.client.connect import connect
from servolink.errors import ConnectionLost, RequestTimeout, ServolinkError
from servolink.platforms.pseudo_terminals import AVAILABLE
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
)
from servolink.protocol.servos import ALL_SERVOS, QueryServoRequest
from servolink.script import FAILED, OK
from servolink.transports.registry import create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve

_SERVOS = 16
_BOW, _LEAN, _RISE, _WAVE, _PAD, _BUTTON, _PROJECT = 1, 2, 3, 1, 1, 3, 42  # ids on the board
_FAST = 0.05  # the duration of movements with `--fast`, as a share of the usual one
_IMPATIENT, _LATER = 0.3, 0.3  # seconds that the client waits for a delayed response, and from the move to the response
_REACTION = 30.0  # seconds in which a button event must have come, however slow the machine


async def show_servos(scene: Scene) -> StageResult:
    """List the servos."""
    servos = await scene.board.servos()
    scene.stage.say(f"connected to {scene.board.url}")
    rows = [(servo.servo_id, servo.angle, servo.current, servo.temperature) for servo in servos]
    scene.stage.table(Table(("servo", "angle", "current (raw)", "temperature (raw)"), rows))
    return StageResult(
        {"url": scene.board.url, "servos": len(servos), "round_trip_seconds": scene.board.stats.round_trip(50)},
        {
            f"all {_SERVOS} servos responded": len(servos) == _SERVOS,
            "their angles are the board's": {servo.servo_id: int(servo.angle) for servo in servos} == scene.angles,
        },
    )


async def move_pose(scene: Scene) -> StageResult:
    """Move all servos at once and watch them."""
    pose = {servo_id: round(90 * math.sin(servo_id / 16 * 2 * math.pi)) for servo_id in scene.angles}
    asked = 1.5 * scene.pace
    seconds = await scene.watch(pose, await scene.board.move(pose, duration=asked))
    return StageResult(
        {"targets": pose, "asked_seconds": asked, "seconds": seconds},
        {"every servo arrived": scene.angles == pose, "none was early": seconds >= asked},
    )


async def run_action(scene: Scene) -> StageResult:
    """Store an action and run it."""
    bow = scene.action(_BOW, "Bow", lambda servo_id: 60 if servo_id % 2 else -60)
    await scene.board.add_action(bow)
    stored = await scene.board.action(_BOW)
    scene.stage.say(f"stored and read back: action {_BOW} '{stored.action_caption}', {len(stored.steps)} steps")
    await scene.board.run_action(_BOW)
    seconds = await scene.watch(_targets(bow), bow.seconds)
    return StageResult(
        {"action_id": _BOW, "steps": len(bow.steps), "seconds": seconds},
        {
            "the action reads back as it was written": stored == bow,
            "running it moved every servo there": scene.angles == _targets(bow),
        },
    )


async def run_macro(scene: Scene) -> StageResult:
    """Store a macro of two actions and run it."""
    lean = scene.action(_LEAN, "Lean", lambda servo_id: 75 * math.cos(servo_id / 16 * 2 * math.pi))
    rise = scene.action(_RISE, "Rise", lambda servo_id: -5 * servo_id)
    pause = MacroCommand(10 * scene.interval(0.1), MacroCommandType.DELAY)
    wave = Macro(_WAVE, "Wave", (MacroCommand(_LEAN), pause, MacroCommand(_RISE, ratio=80)))
    for action in (lean, rise):
        await scene.board.add_action(action)
    await scene.board.add_macro(wave)
    stored = await scene.board.macro(_WAVE)
    scene.stage.say(f"stored and read back: macro {_WAVE} 'Wave': lean, wait, rise at 80 % speed")
    await scene.board.run_macro(_WAVE)
    seconds = await _watch_wave(scene)
    return StageResult(
        {"macro_id": _WAVE, "commands": len(wave.commands), "seconds": seconds},
        {
            "the macro reads back as it was written": stored == wave,
            "it ended in its last pose": scene.angles == _targets(rise),
        },
    )


async def press_button(scene: Scene) -> StageResult:
    """Store a joystick table, press a button, and check the event and the macro of the button."""
    loop, virtual = asyncio.get_running_loop(), scene.virtual
    await scene.board.add_joystick_table(JoystickTable(_PAD, "Pad", (Button(_BUTTON, "Wave", _WAVE),)))
    await scene.board.set_active_joystick_table(_PAD)
    async with scene.board.button_events() as events:
        pressed_at = loop.time()
        virtual.press_button(_BUTTON, pressed_at)
        is_started = virtual.player.macro_id == _WAVE
        async with asyncio.timeout(_REACTION):
            pressed = await anext(events)
        latency = loop.time() - pressed_at
        virtual.release_button(_BUTTON, loop.time())
        async with asyncio.timeout(_REACTION):
            released = await anext(events)
    scene.stage.say(f"button {pressed.button_id}: {pressed.kind}, {latency * 1000:.1f} ms after it went down")
    await _watch_wave(scene)
    seen = [(event.button_id, event.kind) for event in (pressed, released)]
    in_last_pose = scene.angles == _targets(await scene.board.action(_RISE))
    return StageResult(
        {"button_id": pressed.button_id, "events": [pressed.kind, released.kind], "event_seconds": round(latency, 6)},
        {
            f"button {_BUTTON} sent press and up": seen == [(_BUTTON, "press"), (_BUTTON, "up")],
            "the board started the button's macro, which ended in its last pose": is_started and in_last_pose,
        },
    )


async def survive_damage(scene: Scene) -> StageResult:
    """Damage a bit of one response."""
    before, damaged = scene.counters(), scene.line.damaged
    scene.line.damage_next()
    scene.stage.say("one bit of the next response is changed on the line; then all angles are read")
    response = await scene.board.request(QueryServoRequest(ALL_SERVOS))
    since, damaged = scene.counted_since(before), scene.line.damaged - damaged
    return StageResult(
        {"damaged_responses": damaged, **since},
        {
            "exactly one response was damaged": damaged == 1,
            "the damaged response was thrown away and asked for again": min(since["skipped_bytes"], since["retries"])
            > 0,
            "the angles are right": {state.servo_id: state.angle for state in response.servos} == scene.angles,
        },
    )


async def survive_delay(scene: Scene) -> StageResult:
    """Delay a response until the request has timed out and the servos have moved."""
    await scene.board.servos()  # no response to an earlier repetition may be outstanding
    loop, before, held, old = asyncio.get_running_loop(), scene.counters(), scene.line.held, scene.angles
    scene.stage.say(
        f"servo 1 is at {old[1]}°; all angles are read, and the response is held back until nobody waits for it"
    )
    scene.line.hold_next()
    timed_out = False
    try:
        await scene.board.request(QueryServoRequest(ALL_SERVOS), timeout=_IMPATIENT)
    except RequestTimeout:
        timed_out = True
    await scene.board.move(dict.fromkeys(old, 0), duration=0.01)
    async with asyncio.timeout(_REACTION):
        while any(scene.angles.values()):  # or they could rightly be read on their way
            await asyncio.sleep(0.01)
            scene.virtual.advance(loop.time())
    scene.stage.say("all servos go to 0°, and all angles are read again, while the old response is still to come")
    loop.call_later(_LATER, scene.line.release)
    read = {servo.servo_id: int(servo.angle) for servo in await scene.board.servos()}
    since, held = scene.counted_since(before), scene.line.held - held
    scene.stage.say("queries that were sent again count as well, and responses that came behind the one held back")
    return StageResult(
        {"delayed_responses": held, "late_angle": old[1], "angle": read[1], **since},
        {
            "exactly one response was delayed past its time": timed_out and held == 1,
            "a fence showed the late response to be late": min(since["late_responses"], since["fences"]) > 0,
            f"servo 1 is read at {read[1]}°, and all angles are right": read == scene.angles != old,
        },
    )


async def export_project(scene: Scene) -> StageResult:
    """Write everything on the board into a file."""
    await scene.board.write_project_id(_PROJECT)
    await scene.board.add_servo_parameters([ServoParameter(1, servo_caption="left arm")])
    project = await scene.board.export_project()
    save_project(scene.file, project)
    scene.stage.say(f"{scene.file}: {len(project.actions)} actions, each part read twice; the first lines:")
    for line in scene.file.read_text(encoding="utf-8").splitlines()[:9]:
        scene.stage.say(f"   {line}")
    return StageResult(
        {"file": str(scene.file), "actions": len(project.actions), "macros": len(project.macros)},
        {"the file holds what is on the board": load_project(scene.file) == project},
    )


async def pull_cable(scene: Scene) -> StageResult:
    """Begin to write the file to a second board, and pull the cable in the middle."""
    line, reached = FaultyLine(create(scene.second_url)), list[Progress]()

    def on_progress(progress: Progress) -> None:
        reached.append(progress)
        if progress.phase == "writing" and progress.done * 2 >= progress.total:
            line.pull()

    reason = ""
    try:
        async with connect(line) as board:
            await board.apply_project(load_project(scene.file), folder=scene.file.parent, on_progress=on_progress)
    except ConnectionLost as error:
        reason = str(error)
    at = reached[-1]
    scene.stage.say(f"pulled while {PHASES[at.phase]}, at {at.item}: {reason}")
    async with connect(scene.second_url) as board:
        is_unfinished = await board.has_unfinished_import()
    return StageResult(
        {"at": at.item, "done": at.done, "total": at.total},
        {"the import ended in the middle": bool(reason), "the board itself says that it is unfinished": is_unfinished},
    )


async def finish_import(scene: Scene) -> StageResult:
    """Continue the import, and compare."""
    project = load_project(scene.file)
    async with connect(scene.second_url) as board:
        applied = await board.apply_project(project, folder=scene.file.parent)
        scene.stage.say("the same import again: it goes on where it was, and reads back what it writes")
        plan = await board.plan_project(project)
        scene.stage.say(f"plan: {len(plan.changes)} differences")
    return StageResult(
        {"differences": len(plan.changes), "backup": str(applied.backup)},
        {
            "it went on": applied.resumed,
            "0 differences": not plan.changes,
            "both virtual boards store the same": scene.second.storage.contents == scene.virtual.storage.contents,
        },
    )


STEPS: tuple[tuple[str, str, Callable[[Scene], Awaitable[StageResult]]], ...] = (
    ("servos", "A board with 16 servos, read over a serial port", show_servos),
    ("pose", "All servos move at once", move_pose),
    ("action", "An action, stored on the board and run", run_action),
    ("macro", "A macro, stored on the board and run", run_macro),
    ("button", "A joystick button that starts the macro", press_button),
    ("damaged", "A damaged response", survive_damage),
    ("late", "A late response", survive_delay),
    ("export", "Everything on the board, as a project file", export_project),
    ("pulled", "The project into a second board, whose cable is pulled", pull_cable),
    ("resumed", "Plugged in again", finish_import),
)
"""Name, title and function of each step."""


async def _watch_wave(scene: Scene) -> float:
    """Show the servos until the macro Wave has ended; return how long that took."""
    move, pause = scene.interval(0.7), scene.interval(0.1)
    return await scene.watch(_targets(await scene.board.action(_RISE)), (move + pause + move / 0.8) / 100)


def _targets(action: Action) -> dict[int, int]:
    return {step.servo_id: step.degree for step in action.steps}


@Command(
    "demo",
    FIRST_STEPS,
    help="show all of it on a virtual board, in about 10 seconds",
    examples=("demo", "demo --json"),
    options=(flag("--fast", "do the same with quick movements and no time to read"),),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Play all steps: 0, or 1 if a check failed."""
    refuse_board(args, "the demo has virtual boards of its own; leave out --board")
    stage = Stage(as_json=args.json, fast=args.fast)

    async def main(interruption: Interruption) -> int:
        return await _play(stage, _FAST if args.fast else 1.0)

    return run_interruptible(main, "only the demo's own virtual board was moved")


async def _play(stage: Stage, pace: float) -> int:
    """Play all steps on two virtual boards, and return the exit code."""
    start = asyncio.get_running_loop().time()
    virtual, second = VirtualBoard(_SERVOS, seed=1), VirtualBoard(_SERVOS, seed=2)
    folder = tempfile.mkdtemp(prefix="servolink-demo-")
    file = Path(folder) / "demo.servolink.json"
    with cleanup(partial(shutil.rmtree, folder, ignore_errors=True)):
        async with _served(virtual) as url, _served(second) as second_url:
            line = FaultyLine(create(url))
            async with connect(line) as board:
                failed = await _steps(Scene(board, virtual, line, second, second_url, stage, file, pace))
                stats = board.stats.as_dict()
    seconds = round(asyncio.get_running_loop().time() - start, 3)
    stage.end({"ok": not failed, "failed": failed, "seconds": seconds, "next": _next_commands(), "stats": stats})
    return FAILED if failed else OK


@asynccontextmanager
async def _served(board: VirtualBoard) -> AsyncIterator[str]:
    """Serve `board` as a serial port, where the system can; yield its address."""
    async with serve(board, pty=AVAILABLE, tcp=None if AVAILABLE else "127.0.0.1:0") as (url,):
        yield url


async def _steps(scene: Scene) -> list[str]:
    """Play the steps and return the names of failed steps; an error ends the demo."""
    failed: list[str] = []
    for name, title, play in STEPS:
        scene.stage.begin(title)
        try:
            outcome = await play(scene)
        except (ServolinkError, TimeoutError) as error:
            reason = str(error) or "nothing came in time"
            await scene.stage.finish(name, StageResult({"error": reason}, {reason: False}))
            return [*failed, name]
        await scene.stage.finish(name, outcome)
        if not outcome.ok:
            failed.append(name)
    return failed


def _next_commands() -> list[str]:
    """Return commands to paste, which work in any folder."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    servolink = own_name()
    return [
        f"{servolink} virtual --tcp {place}",
        f"{servolink} --board tcp://{place} servos",
        f"{servolink} --board tcp://{place} move 1=60 2=-30 --speed 45",
    ]


def own_name() -> str:
    """Return how this program was called."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m servolink"
    found = shutil.which("servolink")
    return "servolink" if found and Path(found).resolve() == called.resolve() else shlex.quote(str(called))
