"""`servolink events` outlives the board's absence."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from tests.cli.programs import finished, started


def serve(address: str, script: Path) -> tuple[subprocess.Popen[str], str]:
    """Serve a board over TCP; return the server and its address."""
    server = started("virtual", "--tcp", address, "--script", str(script))
    assert server.stdout is not None
    return server, server.stdout.readline().split()[1].removeprefix("tcp://")


def test_events_go_on_when_the_board_is_back(tmp_path: Path) -> None:
    script = tmp_path / "script"
    script.write_text("\n".join(f"{at / 5} press 3" for at in range(1, 200)), encoding="utf-8")
    server, address = serve("127.0.0.1:0", script)
    events = started("--url", f"tcp://{address}", "events", "--json", "--count", "1000000")
    assert events.stdout is not None
    assert events.stderr is not None
    before = json.loads(events.stdout.readline())
    server.kill()
    finished(server)
    told = [events.stderr.readline() for _ in range(2)]
    serve(address, script)
    told.append(events.stderr.readline())
    after = next(event for event in map(json.loads, events.stdout) if event["seconds"] > before["seconds"] + 0.3)
    assert before["button_id"] == after["button_id"] == 3
    assert told == [
        "listening for button events until Ctrl-C\n",
        "servolink: the connection is lost; trying to get it back\n",
        "servolink: the board is back\n",
    ]
