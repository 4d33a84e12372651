"""The programs of docs/examples do what they say, each as a program of its own with a virtual board."""

from __future__ import annotations

import asyncio
import csv
import json
import os
import re
import runpy
import signal
import sys
from pathlib import Path

import pytest

from servolink.virtual import VirtualBoard, serve
from tests import processes

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "docs/examples"
PAGE = ROOT / "docs/how-to/example-programs.md"
GUARD = 120.0  # seconds after which a test has failed
PAD = """
class error(Exception): pass
class Pad:
    seen = 0
    def get_axis(self, axis): return (0.05, 1.0)[axis]
    def get_button(self, button):
        Pad.seen += 1
        return Pad.seen > 30
class joystick:
    JoystickType = object
    get_count = staticmethod(lambda: 1)
    Joystick = staticmethod(lambda number: Pad())
class event:
    pump = staticmethod(lambda: None)
init = lambda: None
"""
"""Stand-in of pygame: a gamepad whose stick is held to one side until its button is pressed."""


def environment(*folders: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (*folders, ROOT))), "SDL_VIDEODRIVER": "dummy"}


def printed(name: str, *words: str, folder: Path, code: int = 0) -> str:
    """Run an example to its end, and return what it prints."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *words]
    done = processes.run(command, cwd=folder, env=environment(folder))
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


def test_one_servo(tmp_path: Path) -> None:
    assert printed("one_servo.py", folder=tmp_path) == "servo 1 is at 30 degrees\nservo 1 is at 0 degrees\n"


def test_a_gamepad(tmp_path: Path) -> None:
    (tmp_path / "pygame.py").write_text(PAD, encoding="utf-8")
    found = re.fullmatch(r"stopped at \[(-?\d+), (\d+)\]\n", printed("gamepad.py", folder=tmp_path))
    assert found is not None
    assert abs(int(found[1])) < 5  # its stick is at rest
    assert 30 <= int(found[2]) <= 80


def test_a_gamepad_that_is_not_there(tmp_path: Path) -> None:
    pytest.importorskip("pygame", reason="for this example")
    assert "no gamepad is plugged in" in printed("gamepad.py", folder=tmp_path, code=1)


def test_a_dance_on_a_button(tmp_path: Path) -> None:
    async def main() -> None:
        virtual = VirtualBoard(servos=2)
        loop = asyncio.get_running_loop()

        def press(button: int) -> None:
            virtual.press_button(button, loop.time())
            virtual.release_button(button, loop.time())

        async with asyncio.timeout(GUARD), serve(virtual, tcp="127.0.0.1:0") as (url,):
            words = [str(EXAMPLES / "dance_on_a_button.py"), url]
            program = await processes.start_async(sys.executable, *words, stdout=-1, env=environment())
            assert program.stdout is not None
            assert await program.stdout.readline() == b"press a button\n"
            for buttons, said in (([1], b"danced\n"), ([1, 2], b"stopped\n"), ([1], b"danced\n")):
                for button in buttons:
                    press(button)
                assert await program.stdout.readline() == said
            program.kill()
            await program.communicate()

    asyncio.run(main())


def test_two_boards(tmp_path: Path) -> None:
    async def main() -> None:
        boards = VirtualBoard(servos=2), VirtualBoard(servos=2)
        async with (
            asyncio.timeout(GUARD),
            serve(boards[0], tcp="127.0.0.1:0") as (left,),
            serve(boards[1], tcp="127.0.0.1:0") as (right,),
        ):
            said = await asyncio.to_thread(printed, "two_boards.py", left, right, folder=tmp_path)
        assert said == "both are at 40\nboth are at -40\nboth are at 0\n"

    asyncio.run(main())


def test_watching_into_a_csv_file(tmp_path: Path) -> None:
    printed("watch_to_csv.py", "virtual://?servos=2", "out.csv", "0.5", folder=tmp_path)
    with (tmp_path / "out.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 4
    assert {row["servo"] for row in rows} == {"1", "2"}
    assert rows[-1]["state"] == "ready"
    assert float(rows[-1]["seconds"]) > float(rows[0]["seconds"])


def test_tests_with_a_fake_board(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", "-n0"]
    done = processes.run(
        [*command, "-c", os.devnull, str(EXAMPLES / "test_wave.py")], cwd=tmp_path, env=environment(), check=True
    )
    assert "2 passed" in done.stdout


def test_a_wave_in_ros(tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="for this example", exc_type=ImportError)
    command = [sys.executable, "-m", "servolink", "--board", "virtual://?servos=2", "ros2"]
    within = {**environment(), "ROS_DOMAIN_ID": "76", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    node = processes.start(command, env=within)
    assert node.stdout is not None
    assert node.stdout.readline() == "ros2 /servolink\n"
    done = processes.run([sys.executable, str(EXAMPLES / "ros_wave.py")], cwd=tmp_path, env=within)
    processes.finish(node, signal.SIGTERM)
    assert done.stdout == "servo_1 is at 20 degrees\nservo_1 is at 0 degrees\n", done.stderr


def test_a_web_api(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fastapi", reason="for this example")
    pytest.importorskip("httpx2", reason="for the client of FastAPI")
    from fastapi.testclient import TestClient  # pyright: ignore[reportMissingImports]

    monkeypatch.setenv("SERVOLINK_BOARD", "virtual://?servos=2")
    app = runpy.run_path(str(EXAMPLES / "web_api.py"))["app"]
    with TestClient(app, base_url="http://127.0.0.1") as client:
        assert [servo["servo"] for servo in client.get("/servos").json()] == [1, 2]
        assert client.post("/move", json={"targets": {"1": 20}, "speed": 60}).json()["seconds"] > 0
        refused = client.post("/move", json={"targets": {"9": 20}})
        assert (refused.status_code, "no servo 9" in refused.json()["error"]) == (409, True)
        assert client.post("/stop").json() == {"state": "stopped"}
        assert {servo["state"] for servo in client.get("/servos").json()} == {"stopped"}
        assert client.get("/servos", headers={"Host": "evil.example"}).status_code == 400


def test_a_notebook(tmp_path: Path) -> None:
    notebook = json.loads((EXAMPLES / "notebook.ipynb").read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in notebook["cells"]}) == len(notebook["cells"])
    code = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell.get("outputs", []) == [] for cell in notebook["cells"])
    shown = "print([int(servo.angle) for servo in readings[-1].servos[:2]])"
    (tmp_path / "cells.py").write_text("\n".join([*code, shown, ""]), encoding="utf-8")
    done = processes.run([sys.executable, "-W", "error", "cells.py"], cwd=tmp_path, env=environment(), check=True)
    assert done.stdout == "[0, 0]\n"


def test_the_page_lists_each_program() -> None:
    listed = set(re.findall(r"\(\.\./examples/(\w+\.(?:py|ipynb))\)", PAGE.read_text(encoding="utf-8")))
    assert listed == {path.name for path in EXAMPLES.iterdir() if path.suffix in {".py", ".ipynb"}}
