"""The pictures of terminals in these pages: `python -m docs.terminal_picture` runs the commands and draws them."""

from __future__ import annotations

import fcntl
import io
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

from rich.console import Console
from rich.terminal_theme import TerminalTheme
from rich.text import Text

FOLDER = Path(__file__).parent / "pictures"
COMMANDS = {
    "demo": "demo --fast",
    "watch": "watch --board virtual:// --seconds 1",
    "plan": "plan servolink/studio/demo.servolink.json --board virtual://",
}
"""Words after `servolink`, by the name of the picture."""
WIDTH = 80

_THEME = TerminalTheme(
    (20, 24, 31),
    (222, 228, 236),
    [(20, 24, 31), (240, 113, 120), (126, 211, 133), (255, 203, 107), (110, 168, 254), (199, 146, 234), (86, 199, 214)],
    [(84, 94, 110), (255, 139, 146), (150, 230, 156)],
)
_ROWS = 16
_LIVE_END = re.compile(r"\x1b\[\?(?:1049l|25h)")
_FRAME_END = re.compile(r"\r(?:\x1b\[2K\x1b\[1A)*\x1b\[2K")
_WEB_FONT = re.compile(r"\s*@font-face \{.*?\}", re.DOTALL)


def run(words: str) -> str:
    """Run a command on a terminal of its own and return the text it wrote, with escape sequences."""
    terminal, inner = pty.openpty()
    fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", 60, WIDTH, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "NO_COLOR"} | {"TERM": "xterm-256color"}
    command = [sys.executable, "-m", "servolink", *words.split()]
    output = io.BytesIO()
    with subprocess.Popen(command, stdin=inner, stdout=inner, stderr=inner, env=environment, cwd=FOLDER.parents[1]):  # noqa: S603 - our own
        os.close(inner)
        while chunk := _read(terminal):
            output.write(chunk)
    os.close(terminal)
    return output.getvalue().decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # Linux reports the end of a pseudo-terminal as an error
        return b""


def steps(output: str, *numbers: int) -> str:
    """Return what the terminal shows of these steps in the end, in colour: of a live picture only its last frame."""
    shown = []
    for step in re.split(r"\r\n(?=\x1b\[1m\d+\. )", output):
        if not step.startswith(tuple(f"\x1b[1m{number}. " for number in numbers)):
            continue
        heading, _, live = step.partition("\x1b[?25l")
        shown.append((heading + _FRAME_END.split(live)[-1].replace("\x1b[?25h", "")).strip())
    return "\n\n...\n\n".join(shown).replace("\r\n", "\n").strip()


def end(output: str) -> str:
    """Return what the terminal shows in the end, without the middle of a long text."""
    rows = _LIVE_END.split(output)[-1].strip().splitlines()
    if len(rows) > 2 * _ROWS:
        rows[_ROWS:-_ROWS] = ["..."]
    return "\n".join(rows)


def picture(name: str) -> str:
    """Run a command, and return its terminal as SVG."""
    words = COMMANDS[name]
    output = run(words)
    shown = f"...\n\n{steps(output, 2, 6)}" if name == "demo" else end(output)
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(Text.from_ansi(f"$ servolink {words.removesuffix(' --fast')}\n{shown}"))
    svg = console.export_svg(title=f"servolink {name}", theme=_THEME, unique_id=name)
    return _WEB_FONT.sub("", svg)


if __name__ == "__main__":
    for name in COMMANDS:
        (FOLDER / f"{name}.svg").write_text(picture(name), encoding="utf-8")
