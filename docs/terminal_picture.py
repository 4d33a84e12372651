"""The picture of the demo on the first page: `python -m docs.terminal_picture` runs the demo and draws it again."""

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

PICTURE = Path(__file__).parent / "pictures/demo.svg"
WIDTH = 80

_THEME = TerminalTheme(
    (20, 24, 31),
    (222, 228, 236),
    [(20, 24, 31), (240, 113, 120), (126, 211, 133), (255, 203, 107), (110, 168, 254), (199, 146, 234), (86, 199, 214)],
    [(84, 94, 110), (255, 139, 146), (150, 230, 156)],
)
_FRAME_END = re.compile(r"\r(?:\x1b\[2K\x1b\[1A)*\x1b\[2K")
_WEB_FONT = re.compile(r"\s*@font-face \{.*?\}", re.DOTALL)


def run_demo() -> str:
    """Run the demo on a terminal of its own and return what it wrote, with escape sequences."""
    terminal, inner = pty.openpty()
    fcntl.ioctl(inner, termios.TIOCSWINSZ, struct.pack("HHHH", 60, WIDTH, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "NO_COLOR"} | {"TERM": "xterm-256color"}
    demo = [sys.executable, "-m", "servolink", "demo", "--fast"]
    output = io.BytesIO()
    with subprocess.Popen(demo, stdin=inner, stdout=inner, stderr=inner, env=environment):  # noqa: S603 - our own
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


def draw(shown: str) -> str:
    """Return the text of a terminal as SVG."""
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(Text.from_ansi(f"$ servolink demo\n...\n\n{shown}"))
    svg = console.export_svg(title="servolink demo", theme=_THEME, unique_id="demo")
    return _WEB_FONT.sub("", svg)


if __name__ == "__main__":
    PICTURE.parent.mkdir(exist_ok=True)
    PICTURE.write_text(draw(steps(run_demo(), 2, 6)), encoding="utf-8")
