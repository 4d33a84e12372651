"""`lerobot-rollout` with DAgger: a scripted policy hands over to a person at the leader arm, and takes over again.

`python -m tests.gateways.lerobot_hand_over FOLDER` runs the program in FOLDER/bin, an environment with LeRobot and the
plug-in of the documentation, with keys that are pressed in its terminal and a leader arm that is turned by hand. It
prints what it measures, and fails if a step is missing or the data set does not say who moved what.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import sys
import time
from asyncio.subprocess import PIPE, STDOUT
from collections.abc import Callable
from contextlib import ExitStack
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from servolink.client import Board, ServoReading, connect
from servolink.support import Tasks
from servolink.virtual import VirtualBoard, serve
from tests import processes
from tests.gateways.lerobot_runs import BOARDS, FPS, SERVOS, shared

POLICY = "lerobot_policy_wave"
PATIENCE = 300.0
"""Seconds for what has no bound of its own: LeRobot takes half a minute to start on a machine with nothing else."""
NEAR = 3.0  # degrees
LIFT = 20  # degrees by which the person turns servo 2
IDS = json.loads(SERVOS)


class Arm:
    """Robot or leader arm, as seen by a program that watches."""

    def __init__(self) -> None:
        self.angles: dict[int, float] = {}
        self.states: set[str] = set()
        """States of the servos now."""
        self.has_held = False

    async def watch(self, board: Board) -> None:
        async for reading in board.watch(50.0):
            self.see(reading)

    def see(self, reading: ServoReading) -> None:
        servos = [servo for servo in reading.servos if servo.servo_id in IDS]
        self.angles = {servo.servo_id: float(servo.angle) for servo in servos}
        self.states = {servo.state for servo in servos}
        self.has_held = self.has_held or self.states != {"released"}

    def off(self, other: Arm) -> float:
        """Return the degrees between two arms, at the joint with the most."""
        return max(abs(angle - other.angles[servo_id]) for servo_id, angle in self.angles.items())


class Rollout:
    """The program of LeRobot, and the person who uses it."""

    def __init__(self, hand: VirtualBoard) -> None:
        self.robot, self.leader = Arm(), Arm()
        self.text = ""
        self.is_over = False
        self._hand = hand
        self._keys, self.terminal = os.openpty()

    async def read(self, program: asyncio.subprocess.Process) -> None:
        assert program.stdout is not None
        while line := await program.stdout.readline():
            self.text += line.decode()
        self.is_over = True

    def press(self, key: str) -> None:
        os.write(self._keys, key.encode())

    async def until(self, done: Callable[[], object], what: str) -> float:
        """Wait for something, and return the seconds."""
        begun = time.monotonic()
        while not done():
            if time.monotonic() > begun + PATIENCE or self.is_over:
                sys.exit(
                    f"{what}: in vain, robot {self.robot.angles}, leader {self.leader.angles}\n{self.text[-3000:]}"
                )
            await asyncio.sleep(0.01)
        return time.monotonic() - begun

    async def phase(self, key: str, change: str) -> None:
        """Press a key, and return when LeRobot says that the phase changes."""
        seen = self.text.count(change)
        self.press(key)
        await self.until(lambda: self.text.count(change) > seen, change)

    async def wave(self) -> None:
        """Return when the policy has turned servo 1 to both sides."""
        begun = self.robot.angles[1]
        await self.until(lambda: self.robot.angles[1] > begun + 10, "the policy moves")
        await self.until(lambda: self.robot.angles[1] < begun - 10, "the policy moves back")

    async def lift(self, degrees: int) -> float:
        """Turn servo 2 of the leader by hand, and return the most degrees the robot was behind."""
        begun, loop, most = self.leader.angles[2], asyncio.get_running_loop(), 0.0
        for step in range(1, degrees + 1):
            await asyncio.sleep(1 / LIFT)
            self._hand.push_servo(2, begun + step, loop.time())
            most = max(most, self.robot.off(self.leader))
        await self.until(lambda: self.leader.angles[2] >= begun + degrees - 1, "the lift")
        return most


async def use(rollout: Rollout, *, may_move: bool) -> None:
    """Let the policy move, take over, lift an arm, and let the policy move again."""
    robot, leader = rollout.robot, rollout.leader
    await rollout.until(lambda: "continuous recording started" in rollout.text, "LeRobot starts")
    await rollout.until(lambda: robot.angles and leader.states == {"released"}, "the arms")
    leader.has_held = False
    await rollout.wave()
    before = dict(leader.angles)
    await rollout.phase(" ", "autonomous -> paused")
    if may_move:
        took = await rollout.until(lambda: leader.states == {"ready"} and leader.off(robot) <= 1.0, "the leader turns")
        print(f"  the leader is {leader.off(robot):.0f} degrees from the robot {took:.1f} s after the pause, and holds")
        assert max(abs(leader.angles[each] - before[each]) for each in IDS) > NEAR
    await rollout.phase("\t", "paused -> correcting")
    await rollout.until(lambda: leader.states == {"released"}, "the leader is released")
    await rollout.until(lambda: robot.off(leader) <= NEAR, "the robot meets the leader")
    await rollout.lift(2)  # LeRobot does not say when the robot has met the leader
    await rollout.until(lambda: robot.off(leader) <= 1.0, "the robot follows")
    most = await rollout.lift(LIFT)
    took = await rollout.until(lambda: robot.off(leader) <= 1.0, "the robot follows the person")
    print(
        f"  a lift of {LIFT} degrees in a second: the robot was {most:.0f} degrees behind, and there {took:.2f} s later"
    )
    await rollout.phase("\t", "correcting -> paused")
    if may_move:
        await rollout.until(lambda: leader.states == {"ready"}, "the leader holds")
    await rollout.phase(" ", "paused -> autonomous")
    await rollout.until(lambda: leader.states == {"released"}, "the leader is released again")
    await rollout.wave()
    rollout.press("\x1b")
    assert leader.has_held is may_move


def check(frames: list[tuple[list[float], list[float], bool]]) -> None:
    """Check that each frame says whether policy or person moved: the policy turns servo 1, and the person servo 2."""
    parts = [(mark, list(part)) for mark, part in groupby(frames, lambda frame: frame[2])]
    print("  frames:", ", ".join(f"{len(part)} of the {'person' if mark else 'policy'}" for mark, part in parts))
    assert [mark for mark, _ in parts] == [False, True, False]
    for mark, part in parts:
        first, second = (
            max(turns) - min(turns) for turns in list(zip(*(action for _, action, _ in part), strict=True))[:2]
        )
        assert (second >= LIFT - 2) is mark, (mark, second)
        assert (first >= 8) is not mark, (mark, first)
    state, action, _ = parts[1][1][0]
    step = max(abs(one - other) for one, other in zip(state, action, strict=True))
    print(f"  from the robot to the first action of the person: {step:.1f} degrees")
    assert step <= NEAR


async def hand_over(environment: Path, address: str, *, may_move: bool) -> None:
    """Run a rollout on a board."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        module = folder / f"{POLICY}.py"  # a plug-in as LeRobot finds it: a distribution with such a name
        shutil.copy(Path(__file__).with_name(module.name), module)
        (folder / f"{POLICY}-1.dist-info").mkdir()
        (folder / f"{POLICY}-1.dist-info/METADATA").write_text(f"Metadata-Version: 2.1\nName: {POLICY}\nVersion: 1\n")
        variables = {**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": name}
        variables.pop("DISPLAY", None)  # or LeRobot reads its keys there
        python = (str(environment / "bin/python"), "-m", POLICY)

        async def run(*words: str) -> str:
            done = await asyncio.to_thread(processes.run, (*python, *words), env=variables, check=True)
            return done.stdout

        await run(f"{folder}/policy", str(len(IDS)))
        await roll_out(environment, address, folder, variables, may_move=may_move)
        check(json.loads((await run(f"{folder}/data")).splitlines()[-1]))


async def roll_out(environment: Path, address: str, folder: Path, variables: dict[str, str], *, may_move: bool) -> None:
    """Run the program of LeRobot from its begin to its end."""
    options = (
        *("--strategy.type=dagger", "--strategy.record_autonomous=true", f"--policy.path={folder}/policy"),
        *("--robot.type=servolink", "--robot.board=share://robot", f"--robot.servos={SERVOS}", "--robot.id=robot"),
        *("--teleop.type=servolink_leader", "--teleop.board=share://leader", f"--teleop.servos={SERVOS}"),
        *(f"--teleop.may_move={str(may_move).lower()}", "--teleop.id=leader", f"--fps={FPS}", "--play_sounds=false"),
        *("--dataset.repo_id=servolink/rollout_trial", f"--dataset.root={folder}/data", "--dataset.push_to_hub=false"),
        *("--dataset.single_task=Wave", f"--dataset.fps={FPS}", "--dataset.num_episodes=1"),
    )
    hand = VirtualBoard(servos=max(IDS))
    tasks, shares = Tasks(), ExitStack()
    async with serve(hand, tcp="127.0.0.1:0") as (url,):
        try:
            for where, board_name in ((address, "robot"), (url, "leader")):
                await asyncio.to_thread(shares.enter_context, shared(where, board_name))
            rollout = Rollout(hand)
            pipes: dict[str, Any] = {"stdin": rollout.terminal, "stdout": PIPE, "stderr": STDOUT, "env": variables}
            async with connect("share://robot?role=watch") as robot, connect("share://leader?role=watch") as leader:
                program = await processes.start_async(str(environment / "bin/lerobot-rollout"), *options, **pipes)
                reading = tasks.begin(rollout.read(program))
                tasks.begin(rollout.robot.watch(robot))
                tasks.begin(rollout.leader.watch(leader))
                await use(rollout, may_move=may_move)
                await reading
                assert await program.wait() == 0, rollout.text[-3000:]
                late = rollout.text.count("Record loop is running slower")
                print(f"  {late} turns took too long")
                await tasks.close()
        finally:
            await tasks.close()
            await asyncio.to_thread(shares.close)


if __name__ == "__main__":
    for what, address in BOARDS.items():
        for may_move in (True, False):
            print(f"{what}, a leader that may{'' if may_move else ' not'} move:")
            asyncio.run(hand_over(Path(sys.argv[1]), address, may_move=may_move))
