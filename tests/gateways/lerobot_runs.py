"""`lerobot-teleoperate`, `lerobot-record` and `lerobot-replay` at 30 Hz, with a virtual board and with the twin.

`python -m tests.gateways.lerobot_runs FOLDER` runs those in FOLDER/bin, an environment with LeRobot and the plug-in of
the documentation. It prints the rate of each, and fails if one is slower or a step is missing. A busy machine wakes
LeRobot late from its pauses, and so costs frames: with a load of 8 on two processors, 95 to 119 of 120 were recorded.
What the plug-in costs is in the turns that take longer than their period, which LeRobot reports: they must be few.
"""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

from tests import processes

FPS = 30
EPISODE = 4
"""Seconds of an episode."""
DEMO = Path(__file__).parents[2] / "servolink/studio/demo.servolink.json"
BOARDS = {"a virtual board": "virtual://?servos=16", "the twin": f"virtual://?twin={DEMO}"}
SERVOS = "[1, 2, 3, 4, 5, 6]"  # the arms, so that the twin stands


@contextmanager
def shared(address: str, name: str) -> Iterator[None]:
    """Share a board under a name."""
    words = (sys.executable, "-m", "servolink", "share", "--board", address, "--name", name)
    serving = processes.start(words)
    assert serving.stdout is not None
    assert "listening" in serving.stdout.readline(), address
    try:
        yield
    finally:
        processes.finish(serving, signal.SIGTERM)


def run(program: Path, *options: str) -> str:
    """Return what a program of LeRobot has printed. End with what it has printed if it fails."""
    environment = {**os.environ, "HF_HUB_OFFLINE": "1"}
    done = processes.run((str(program), *options), env=environment)
    text = done.stdout + done.stderr
    if done.returncode:
        sys.exit(f"{program.name} ended with {done.returncode}:\n{text[-3000:]}")
    return text


def try_board(programs: Path, what: str, address: str) -> None:
    """Teleoperate, record an episode and replay it on a board."""
    robot = ("--robot.type=servolink", "--robot.board=share://robot", f"--robot.servos={SERVOS}", "--robot.id=robot")
    leader = ("--teleop.type=servolink_leader", "--teleop.board=share://leader", f"--teleop.servos={SERVOS}")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "data"
        data = ("--dataset.repo_id=servolink/trial", f"--dataset.root={folder}")
        stack.enter_context(shared(address, "robot"))
        stack.enter_context(shared("virtual://?servos=16", "leader"))
        options = (*robot, *leader, "--teleop.id=leader")
        text = run(programs / "lerobot-teleoperate", *options, f"--fps={FPS}", f"--teleop_time_s={EPISODE}")
        loops = [float(found) for found in re.findall(r"loop time: ([0-9.]+)ms", text)]
        task = ("--dataset.single_task=Wave", "--dataset.num_episodes=1", "--dataset.push_to_hub=false")
        times = (f"--dataset.fps={FPS}", f"--dataset.episode_time_s={EPISODE}", "--dataset.reset_time_s=1")
        quiet = ("--dataset.video=false", "--play_sounds=false")
        text = run(programs / "lerobot-record", *options, *data, *task, *times, *quiet)
        late = text.count("Record loop is running slower")
        frames = json.loads((folder / "meta/info.json").read_text())["total_frames"]
        episode = ("--dataset.episode=0", f"--dataset.fps={FPS}", "--play_sounds=false")
        run(programs / "lerobot-replay", *robot, *data, *episode)
    print(
        f"{what}: {1000 / median(loops):.1f} Hz, {frames} frames of {FPS * EPISODE} recorded and replayed, "
        f"{late} turns took too long"
    )
    assert median(loops) < 1000 / FPS * 1.1
    assert late <= 0.1 * frames
    assert frames >= FPS * EPISODE * 2 / 3


if __name__ == "__main__":
    for what, address in BOARDS.items():
        try_board(Path(sys.argv[1]) / "bin", what, address)
