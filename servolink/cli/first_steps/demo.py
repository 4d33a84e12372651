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
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from servolink.cli.command import FIRST_STEPS, Command, flag
from servolink.cli.command_session import run_interruptible
from servolink.cli.first_steps.demo_stage import INDENT, FaultyLine, Scene, say, told
from servolink.cli.screen.live import PHASES
from servolink.cli.screen.output import Form, Table
from servolink.cli.screen.result import CommandResult, Part, Returned, print_for_people, show
from servolink.cli.screen.terminal import cleanup
from servolink.cli.usage import refuse_board
from servolink.client import connect
from servolink.errors import ConnectionLost, RequestTimeout, ServolinkError
from servolink.project import Progress, load_project, save_project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    QueryServoRequest,
    ServoParameter,
)
from servolink.support import ExitCode, PseudoTerminal
from servolink.transports import create
from servolink.virtual import VirtualBoard, serve

_SERVOS = 16
_BOW, _LEAN, _RISE, _WAVE, _PAD, _BUTTON, _PROJECT = 1, 2, 3, 1, 1, 3, 42  # ids on the board
_FAST = 0.05  # the duration of movements with `--fast`, as a share of the usual one
_READING = 0.5  # seconds to read what a step has shown
_IMPATIENT, _LATER = 0.3, 0.3  # seconds that the client waits for a delayed response, and from the move to the response
_REACTION = 30.0  # seconds in which a button event must have come, however slow the machine

Play: TypeAlias = Callable[[Scene], Awaitable[dict[str, Any]]]
STEPS: dict[str, Play] = {}
"""Function of each step by name: its docstring is the title; it checks what happens and returns what it measured."""


def step(name: str) -> Callable[[Play], Play]:
    """Return a decorator for the next step of the demo."""
    return lambda play: STEPS.setdefault(name, play)


@step("servos")
async def show_servos(scene: Scene) -> dict[str, Any]:
    """A board with 16 servos, read over a serial port."""
    servos, board = await scene.board.servos(), scene.board
    say(f"connected to {board.url}")
    rows = [(servo.servo_id, servo.angle, servo.current, servo.temperature) for servo in servos]
    print_for_people(Table(("servo", "angle", "current (raw)", "temperature (raw)"), rows))
    scene.check(f"all {_SERVOS} servos responded", len(servos) == _SERVOS)
    scene.check("their angles are the board's", {one.servo_id: int(one.angle) for one in servos} == scene.angles)
    return {"url": board.url, "servos": len(servos), "round_trip_seconds": board.stats.round_trip(50)}


@step("pose")
async def move_pose(scene: Scene) -> dict[str, Any]:
    """All servos move at once."""
    pose = {servo_id: round(90 * math.sin(servo_id / 16 * 2 * math.pi)) for servo_id in scene.angles}
    asked = 1.5 * scene.pace
    seconds = await scene.watch(pose, await scene.board.move(pose, duration=asked))
    scene.check("every servo arrived", scene.angles == pose)
    scene.check("none was early", seconds >= asked)
    return {"targets": pose, "asked_seconds": asked, "seconds": seconds}


@step("action")
async def run_action(scene: Scene) -> dict[str, Any]:
    """An action, stored on the board and run."""
    bow = scene.action(_BOW, "Bow", lambda servo_id: 60 if servo_id % 2 else -60)
    await scene.board.add_action(bow)
    stored = await scene.board.action(_BOW)
    say(f"stored and read back: action {_BOW} '{stored.action_caption}', {len(stored.steps)} steps")
    await scene.board.run_action(_BOW)
    seconds = await scene.watch(_targets(bow), bow.seconds)
    scene.check("the action reads back as it was written", stored == bow)
    scene.check("running it moved every servo there", scene.angles == _targets(bow))
    return {"action_id": _BOW, "steps": len(bow.steps), "seconds": seconds}


@step("macro")
async def run_macro(scene: Scene) -> dict[str, Any]:
    """A macro, stored on the board and run."""
    rise = scene.action(_RISE, "Rise", lambda servo_id: -5 * servo_id)
    await scene.board.add_action(scene.action(_LEAN, "Lean", lambda each: 75 * math.cos(each / 16 * 2 * math.pi)))
    await scene.board.add_action(rise)
    pause = MacroCommand(10 * scene.interval(0.1), MacroCommandType.DELAY)
    wave = Macro(_WAVE, "Wave", (MacroCommand(_LEAN), pause, MacroCommand(_RISE, ratio=80)))
    await scene.board.add_macro(wave)
    stored = await scene.board.macro(_WAVE)
    say(f"stored and read back: macro {_WAVE} 'Wave': lean, wait, rise at 80 % speed")
    await scene.board.run_macro(_WAVE)
    seconds = await _watch_wave(scene)
    scene.check("the macro reads back as it was written", stored == wave)
    scene.check("it ended in its last pose", scene.angles == _targets(rise))
    return {"macro_id": _WAVE, "commands": len(wave.commands), "seconds": seconds}


@step("button")
async def press_button(scene: Scene) -> dict[str, Any]:
    """A joystick button that starts the macro."""
    loop, virtual = asyncio.get_running_loop(), scene.virtual
    await scene.board.add_joystick_table(JoystickTable(_PAD, "Pad", (Button(_BUTTON, "Wave", _WAVE),)))
    await scene.board.set_active_joystick_table(_PAD)
    async with scene.board.button_events() as events, asyncio.timeout(_REACTION):
        pressed_at = loop.time()
        virtual.press_button(_BUTTON, pressed_at)
        is_started = virtual.player.macro_id == _WAVE
        pressed = await anext(events)
        latency = loop.time() - pressed_at
        virtual.release_button(_BUTTON, loop.time())
        seen = [pressed, await anext(events)]
    say(f"button {pressed.button_id}: {pressed.kind}, {latency * 1000:.1f} ms after it went down")
    await _watch_wave(scene)
    is_started &= scene.angles == _targets(await scene.board.action(_RISE))
    went = [(event.button_id, event.kind) for event in seen]
    scene.check(f"button {_BUTTON} sent press and up", went == [(_BUTTON, "press"), (_BUTTON, "up")])
    scene.check("the board started the button's macro, which ended in its last pose", is_started)
    return {"button_id": pressed.button_id, "events": [kind for _, kind in went], "event_seconds": round(latency, 6)}


@step("damaged")
async def survive_damage(scene: Scene) -> dict[str, Any]:
    """A damaged response."""
    before = scene.line.damaged
    scene.line.damage_next()
    say("one bit of the next response is changed on the line; then all angles are read")
    with scene.counted() as since:
        response = await scene.board.request(QueryServoRequest(ALL_SERVOS))
    damaged, is_repaired = scene.line.damaged - before, min(since["skipped_bytes"], since["retries"]) > 0
    scene.check("exactly one response was damaged", damaged == 1)
    scene.check("the damaged response was thrown away and asked for again", is_repaired)
    scene.check("the angles are right", {state.servo_id: state.angle for state in response.servos} == scene.angles)
    return {"damaged_responses": damaged, **since}


@step("late")
async def survive_delay(scene: Scene) -> dict[str, Any]:
    """A late response."""
    await scene.board.servos()  # no response to an earlier repetition may be outstanding
    loop, held, old, timed_out = asyncio.get_running_loop(), scene.line.held, scene.angles, False
    say(f"servo 1 is at {old[1]}°; all angles are read, and the response is held back until nobody waits for it")
    with scene.counted() as since:
        scene.line.hold_next()
        try:
            await scene.board.request(QueryServoRequest(ALL_SERVOS), timeout=_IMPATIENT)
        except RequestTimeout:
            timed_out = True
        await scene.board.move(dict.fromkeys(old, 0), duration=0.01)
        async with asyncio.timeout(_REACTION):
            while any(scene.angles.values()):  # or they could rightly be read on their way
                await asyncio.sleep(0.01)
                scene.virtual.advance(loop.time())
        say("all servos go to 0°, and all angles are read again, while the old response is still to come")
        loop.call_later(_LATER, scene.line.release)
        read = {servo.servo_id: int(servo.angle) for servo in await scene.board.servos()}
    held = scene.line.held - held
    say("queries that were sent again count as well, and responses that came behind the one held back")
    scene.check("exactly one response was delayed past its time", timed_out and held == 1)
    scene.check("a fence showed the late response to be late", min(since["late_responses"], since["fences"]) > 0)
    scene.check(f"servo 1 is read at {read[1]}°, and all angles are right", read == scene.angles != old)
    return {"delayed_responses": held, "late_angle": old[1], "angle": read[1], **since}


@step("export")
async def export_project(scene: Scene) -> dict[str, Any]:
    """Everything on the board, as a project file."""
    await scene.board.write_project_id(_PROJECT)
    await scene.board.add_servo_parameters([ServoParameter(1, servo_caption="left arm")])
    project = await scene.board.export_project()
    save_project(scene.file, project)
    say(f"{scene.file}: {len(project.actions)} actions, each part read twice; the first lines:")
    for line in scene.file.read_text(encoding="utf-8").splitlines()[:9]:
        say(f"   {line}")
    scene.check("the file holds what is on the board", load_project(scene.file) == project)
    return {"file": str(scene.file), "actions": len(project.actions), "macros": len(project.macros)}


@step("pulled")
async def pull_cable(scene: Scene) -> dict[str, Any]:
    """The project into a second board, whose cable is pulled."""
    line, reached, reason = FaultyLine(create(scene.second_url)), list[Progress](), ""

    def on_progress(progress: Progress) -> None:
        reached.append(progress)
        if progress.phase == "writing" and progress.done * 2 >= progress.total:
            line.pull()

    try:
        async with connect(line) as board:
            await board.apply_project(load_project(scene.file), folder=scene.file.parent, on_progress=on_progress)
    except ConnectionLost as error:
        reason = str(error)
    at = reached[-1]
    say(f"pulled while {PHASES[at.phase]}, at {at.item}: {reason}")
    scene.check("the import ended in the middle", bool(reason))
    async with connect(scene.second_url) as board:
        scene.check("the board itself says that it is unfinished", await board.has_unfinished_import())
    return {"at": at.item, "done": at.done, "total": at.total}


@step("resumed")
async def finish_import(scene: Scene) -> dict[str, Any]:
    """Plugged in again."""
    project = load_project(scene.file)
    async with connect(scene.second_url) as board:
        applied = await board.apply_project(project, folder=scene.file.parent)
        say("the same import again: it goes on where it was, and reads back what it writes")
        plan = await board.plan_project(project)
    say(f"plan: {len(plan.changes)} differences")
    scene.check("it went on", applied.resumed)
    scene.check("0 differences", not plan.changes)
    scene.check("both virtual boards store the same", scene.second.storage.contents == scene.virtual.storage.contents)
    return {"differences": len(plan.changes), "backup": str(applied.backup)}


async def _watch_wave(scene: Scene) -> float:
    """Show the servos until the macro Wave has ended; return how long that took."""
    move, pause = scene.interval(0.7), scene.interval(0.1)
    return await scene.watch(_targets(await scene.board.action(_RISE)), (move + pause + move / 0.8) / 100)


def _targets(action: Action) -> dict[int, int]:
    return {step.servo_id: step.degree for step in action.steps}


class DemoStep(CommandResult, frozen=True):
    """JSON of each step of `demo`: checks and measurements."""

    step: str
    ok: bool
    checks: dict[str, bool]
    measured: dict[str, Any]


class DemoEnd(CommandResult, frozen=True, kw_only=True):
    """JSON of the last line of `demo`: steps that failed, seconds, commands to try next, and counters."""

    step: str = "end"
    ok: bool
    failed: list[str]
    seconds: float
    next: list[str]
    stats: dict[str, Any]


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
    return run_interruptible(lambda _: _play(fast=args.fast), "only the demo's own virtual board was moved")


async def _play(*, fast: bool) -> Returned:
    """Play all steps on two virtual boards, and return how they went."""
    start = asyncio.get_running_loop().time()
    virtual, second = VirtualBoard(_SERVOS, seed=1), VirtualBoard(_SERVOS, seed=2)
    folder = tempfile.mkdtemp(prefix="servolink-demo-")
    place: dict[str, Any] = {"pty": True} if PseudoTerminal.AVAILABLE else {"tcp": "127.0.0.1:0"}
    with cleanup(partial(shutil.rmtree, folder, ignore_errors=True)):
        async with AsyncExitStack() as stack:
            [url], [second_url] = [await stack.enter_async_context(serve(each, **place)) for each in (virtual, second)]
            line = FaultyLine(create(url))
            board = await stack.enter_async_context(connect(line))
            file = Path(folder) / "demo.servolink.json"
            scene = Scene(board, virtual, line, second, second_url, file, _FAST if fast else 1.0)
            failed = await _steps(scene, fast=fast)
    seconds = round(asyncio.get_running_loop().time() - start, 3)
    stats = board.stats.as_dict()
    end = DemoEnd(ok=not failed, failed=failed, seconds=seconds, next=_next_commands(), stats=stats)
    return Returned(end, end_text(end), ExitCode.FAILED if failed else ExitCode.OK)


async def _steps(scene: Scene, *, fast: bool) -> list[str]:
    """Play the steps and return the names of failed steps; an error ends the demo."""
    failed: list[str] = []
    for number, (name, play) in enumerate(STEPS.items(), 1):
        print_for_people(["", (f"{number}. {(play.__doc__ or '').rstrip('.')}", "bold")])
        scene.checks, reason = {}, ""
        checks = scene.checks
        try:
            measured = await play(scene)
        except (ServolinkError, TimeoutError) as error:
            reason = str(error) or "nothing came in time"
            measured, checks = {"error": reason}, {reason: False}
        ok = all(checks.values())
        show(DemoStep(name, ok, checks, measured), _checked(checks))
        failed += [] if ok else [name]
        if reason:
            break
        if not (fast or Form.json):
            await asyncio.sleep(_READING)
    return failed


def _checked(checks: dict[str, bool]) -> Iterator[Part]:
    for claim, true in checks.items():
        yield from told(f"{INDENT}{'ok' if true else 'FAILED'}: {claim}", "green" if true else "bold red")


def end_text(end: DemoEnd) -> Iterator[Part]:
    """Yield the result of the demo and the commands to try next."""
    result = f"All of it worked, in {end.seconds:.1f} s. Try next"
    if not end.ok:
        result = f"FAILED: {', '.join(end.failed)}. To look closer"
    yield from ("", *told(f"{result}, the first in a terminal of its own:"))
    for command in end.next:
        yield from told(INDENT + command, continued=" \\")


def _next_commands() -> list[str]:
    """Return commands to paste, which work in any folder."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    board = f"--board tcp://{place}"
    words = (f"virtual --tcp {place}", f"{board} servos", f"{board} move 1=60 2=-30 --speed 45")
    return [f"{own_name()} {each}" for each in words]


def own_name() -> str:
    """Return how this program was called."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m servolink"
    found = shutil.which("servolink")
    return "servolink" if found and Path(found).resolve() == called.resolve() else shlex.quote(str(called))
