"""Hostile texts as what is typed: each place of each command refuses them in words that can be shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.cli.index import below
from servolink.support import ExitCode
from tests.cli.terminals import ESCAPE, in_pipe, in_terminal
from tests.proofs.hostile.corpus import PAYLOADS, controls

_ALL = "".join(payload.text for payload in PAYLOADS).replace("\0", "")
_NO_CONTROLS = "".join(character for character in _ALL if character >= " " and character not in "\x7f?&%")
_SHORT = "x\x1b[2J\x9b1m\u202e\udcff"
TEXTS = {"everything": _ALL, "no C0 controls": _NO_CONTROLS, "short": _SHORT}
"""What is refused at once, what gets further, and what could be the name of a file."""
_SELDOM = 9
"""Every so many cases of the other texts run in the default suite."""

TYPED = (
    "{}",
    "--{}",
    "--url {} info",
    "--url tcp://{}:80 info",
    "--url tcp://[{}]:80 info",
    "--url tcp://host:{} info",
    "--url {}://host info",
    "--url virtual://?{} info",
    "--url virtual://?{}=1 info",
    "--url virtual://?servos={} info",
    "--url serial:///dev/{} info",
    "--url hid://{} info",
    "--url usb://{} info",
    "--url replay:///{} info",
    "--byte-order {} info",
    "--caption-encoding {} --url virtual:// info",
    "--timeout {} info",
    "--url virtual://?caption_encoding={} info",
    "info {}",
    "list {}",
    "use {} virtual://",
    "use mine {}",
    "use mine serial:///dev/\udcff{}",
    "firmware {}",
    "firmware install --servos {} --yes",
    "firmware install --battery {} --yes",
    "doctor {}",
    "doctor --print-udev {}",
    "doctor {} --learn",
    "doctor rex --learn --servo {}",
    "board {}",
    "board show {}",
    "board set {} --depth 4",
    "board set rex --angle {}",
    "board forget {}",
    "servos {}",
    "--url virtual:// watch {}",
    "--url virtual:// watch --alarm {}",
    "--url virtual:// watch --csv /{}/x",
    "--url virtual:// record /{}/x --seconds 0.02",
    "--url virtual:// record /dev/null --alarm {}",
    "--url virtual:// move {}",
    "--url virtual:// move {}=1",
    "--url virtual:// move 1=1 --duration {}",
    "stop {}",
    "run {} 1",
    "run action {}",
    "--url virtual:// run macro {} --wait",
    "--url virtual:// release {} --yes",
    "--url virtual:// actions {}",
    "--url virtual:// action show {}",
    "--url virtual:// action set {} --seconds 1",
    "--url virtual:// action add x --pose {}=1",
    "--url virtual:// macro delete {} --yes",
    "--url virtual:// table activate {}",
    "--url virtual:// teach x --button {} --yes",
    "--url virtual:// servo trim {} 3",
    "--url virtual:// request {}",
    "--json --url virtual:// trim {}",
    "--url virtual:// trim --set {}=+1",
    "--json --url virtual:// remote --table {}",
    "project rename x action {} y -o z",
    "actions {}",
    "macros {}",
    "tables {}",
    "--url virtual:// export /{}/x",
    "--url virtual:// plan {}",
    "--url virtual:// apply {} --yes",
    "--url virtual:// rollback {} --yes",
    "backups {}",
    "project {}",
    "project show {}",
    "project show virtual://{}",
    "project show --{}",
    "project new /{}/x",
    "project check {}",
    "project check x --servos {}",
    "project preflight x --servo-limit {}",
    "project play {} x",
    "project mirror x 1 --map {} -o y",
    "project rename x {} 1 y -o z",
    "figure export x /{}/y",
    "figure import {}",
    "twin check {}",
    "twin model x -o /{}/y",
    "twin soften x --macro {}",
    "teach",
    "--url virtual:// teach {} --yes",
    "--url virtual:// teach x {} --yes",
    "--url virtual:// teach x --interval {} --yes",
    "--url virtual:// teach x --file /{}/x 250 --yes",
    "events --count {}",
    "events --seconds {}",
    "decode {}",
    "decode --hex {}",
    "decode --file {}",
    "encode {}",
    'encode {{"packet":"{}"}}',
    'encode {{"id":20020,"fields":{{"{}":1}}}}',
    "show {}",
    "replay {}",
    "report --recording {} --yes",
    "--url {} report --yes --seconds 0 -o /{}/x",
    "convert {} --csv",
    "convert {} --pcap",
    "convert x --csv -o /{}/x",
    "replay x --to {}",
    "replay x --tcp {}",
    "replay x --to virtual --speed {}",
    "show x --packet {}",
    "show x --channel {}",
    "share {}",
    "share --name {}",
    "share --tcp {}",
    "share --watch-tcp {}:1",
    "share --unit {}",
    "share --door-byte-order {}",
    "share --lease-seconds {}",
    "share --take {}",
    "share --give {}",
    "--url {} share --status",
    "--url virtual:// share --pty /dev/null/nowhere/x{}",
    "fleet {}",
    "fleet join {} virtual://",
    "fleet join mqtt://127.0.0.1:1 virtual:// --name {}",
    "fleet join mqtt://127.0.0.1:1 virtual:// --home-assistant --discovery-prefix {}",
    "fleet list --broker {}",
    "fleet list --broker mqtt://{}",
    "fleet list --broker mqtt://127.0.0.1:1 --prefix {}",
    "fleet list --broker mqtts://127.0.0.1:1 --ca {}",
    "fleet list --broker mqtt://127.0.0.1:1 --user {} --password-file {}",
    "fleet run x --broker mqtt://127.0.0.1:1 --groups {}",
    "fleet apply {} --yes",
    "fleet forget {} --yes --broker mqtt://127.0.0.1:1",
    "studio {}",
    "studio --no-browser --port {}",
    "--url {} studio --no-browser",
    "studio --no-browser --host {} --allow-host {}",
    "virtual --tcp {}",
    "virtual --tcp {}:1",
    "virtual --faults {}",
    "virtual --faults {}=1",
    "virtual --servos {}",
    "virtual --script {}",
    "virtual --on-duplicate {}",
    "virtual --tcp 127.0.0.1:0 --state /dev/null/nowhere/x{}",
    "mcp --http {}",
    "mcp --speed-cap {}",
    "ros2 --speed-cap {}",
    "foxglove --listen {}",
    "foxglove --speed {}",
    "bench --requests {}",
    "demo {}",
    "completion {}",
    "complete {}",
    "help {}",
    "wireshark {}",
    "spy {}",
    "spy /dev/null/nowhere --pty {}",
    "spy /dev/null/nowhere --tcp {}",
    "spy /dev/null/nowhere --baudrate {}",
    "spy /dev/null/nowhere --record {}",
    "spy /dev/null/nowhere --record /{}/x",
    "wireshark --caption-encoding {}",
)


def arguments(pattern: str, text: str) -> list[str]:
    """Return the words of `pattern`, with `text` for the braces."""
    return [word.format(text) for word in pattern.split()]


@pytest.fixture(autouse=True)
def _folder_without_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("SERVOLINK_BOARD", "SERVOLINK_URL"):
        monkeypatch.delenv(name, raising=False)


def test_every_command_is_typed_to() -> None:
    assert {*below("")} <= {word for pattern in TYPED for word in pattern.split()}


@pytest.mark.parametrize(
    ("pattern", "kind"),
    [
        pytest.param(pattern, kind, marks=() if kind == "short" or (at + nth) % _SELDOM == 0 else pytest.mark.slow)
        for at, pattern in enumerate(TYPED)
        for nth, kind in enumerate(TEXTS)
    ],
)
def test_what_was_typed_is_shown_as_text(pattern: str, kind: str, caplog: pytest.LogCaptureFixture) -> None:
    typed = arguments(pattern, TEXTS[kind])
    said = in_pipe(*typed)
    assert said.code in (ExitCode.FAILED, ExitCode.USAGE, ExitCode.NO_BOARD)
    assert not controls(said.out + said.err)
    described = in_pipe("--json", *typed)
    assert described.code == said.code
    assert described.out.isascii()
    assert not controls(described.out + described.err)
    if kind == "short":
        seen = in_terminal(*typed)
        assert seen.code == said.code
        assert not controls(ESCAPE.sub("", seen.out)) - {"\r"}
    assert not any(controls(record.getMessage()) for record in caplog.records)


def test_the_environment_is_shown_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SERVOLINK_URL", _ALL)
    said = in_pipe("info")
    assert said.code == ExitCode.USAGE
    assert not controls(said.out + said.err)
