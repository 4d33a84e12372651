"""Text from people and files withstands anything: addresses, faults, scripts, projects, recordings, saved boards."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

from servolink.boards import Alias, Aliases, ProfileFile, announced_boards
from servolink.errors import OpenError, ProfileError, ProjectError, ServolinkError, TransportUnavailable, escape
from servolink.project import BackupStore, ProjectFile
from servolink.support import is_name
from servolink.transports import Address, Faults, LineFaults, NetworkPlace, ReplayTransport, Transport, create
from servolink.virtual import BoardKind, VirtualBoard, load_state, parse_script, save_state
from tests.proofs.fuzz.errors import check

STARTS = (
    "",
    "serial://",
    "serial:///dev/",
    "tcp://",
    "hid://",
    "usb://",
    "memory://",
    "replay:///",
    "virtual://?",
    "/dev/",
)
_KNOWN = {"serial", "tcp", "hid", "usb", "memory", "replay", "virtual"}


def check_address(data: bytes) -> None:
    """Read the text as an address, and make its transport without opening it."""
    if not data:
        return
    url = STARTS[data[0] % len(STARTS)] + data[1:].decode("utf-8", "surrogateescape")
    try:
        parsed = Address.parse(url)
        options = parsed.options | parsed.connection_options
        for part in (parsed.scheme, parsed.host, parsed.port, parsed.path, *options, *options.values()):
            assert all(character >= " " and character != "\x7f" for character in part)
        if parsed.scheme in _KNOWN:  # others may be those of plug-ins, which takes long to find out
            transport = create(url)
            assert isinstance(transport, Transport)
            assert transport.url == url.strip()
    except TransportUnavailable as error:
        check(error)


def check_faults(data: bytes) -> None:
    """Read the text as faults of a line, and as an address to listen on."""
    text = data.decode("utf-8", "surrogateescape")
    try:
        line = LineFaults(Faults.parse(text), seed=1)
    except TransportUnavailable as error:
        check(error)
    else:
        for at in range(8):
            assert sum(len(piece) for _, piece in line.apply(data, float(at))) <= 4 * len(data)
    try:
        _, port = NetworkPlace.parse(text)
        assert 0 <= port <= 65535
    except TransportUnavailable as error:
        check(error)


def check_script(data: bytes) -> None:
    """Read the text as a script of button presses."""
    try:
        deeds = parse_script(data.decode("utf-8", "replace"))
    except ValueError as error:
        check(error)
    else:
        assert [deed.at for deed in deeds] == sorted(deed.at for deed in deeds)
        assert all(0 <= deed.at <= 2e6 and all(0 <= number < 2**32 for number in deed[1:2]) for deed in deeds)


def check_project(data: bytes) -> None:
    """Read the bytes as a project file; what was read survives being written and read again."""
    for unchecked in (False, True):
        try:
            read = ProjectFile.parse(data, unchecked=unchecked).project
        except ProjectError as error:
            check(error)
        else:
            text = ProjectFile(read).text()
            assert all(character == "\n" or escape(character) == character for character in text)
            assert ProjectFile.parse(text, unchecked=unchecked).project == read.sorted()


def check_recording(path: Path) -> None:
    """Read the file as a recording."""
    asyncio.run(_replay(path))


async def _replay(path: Path) -> None:
    transport = ReplayTransport(path, timing=False)
    try:
        await transport.open(_Deaf())
    except OpenError as error:
        check(error)
    await transport.close()


def check_saved_board(path: Path) -> None:
    """Read the file as the saved state of a virtual board."""
    board = VirtualBoard(3, kind=BoardKind(memory=1000))
    try:
        load_state(board, path)
    except ServolinkError as error:
        check(error)
    else:
        assert board.storage.used <= 1000
        save_state(board, path)
        load_state(board, path)


def check_names_of_boards(data: bytes) -> None:
    """Read the bytes as the user's file of names."""
    path = Aliases.path()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    try:
        names = Aliases.load()
    except TransportUnavailable as error:
        check(error)
        return
    assert all(map(is_name, names))
    Aliases.save("more", Alias("virtual://"))
    assert Aliases.load() == names | {"more": Alias("virtual://")}


def check_profile_of_a_board(data: bytes) -> None:
    """Read the bytes as the profile of a board; what was read survives being written and read again."""
    path = ProfileFile("rex").path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    try:
        read = ProfileFile("rex").load()
    except ProfileError as error:
        check(error)
        lines = [int(line) for line in re.findall(r"rex\.toml, line (\d+): ", str(error))]
    else:
        lines = [1]
        assert read is not None
        ProfileFile("rex").save(read)
        assert ProfileFile("rex").load() == read
    assert len(lines) == 1
    assert 1 <= lines[0] <= data.count(b"\n") + 1


def check_journal(content: bytes, folder: Path, marker: int) -> None:
    """Read the bytes as the journal of an import."""
    (folder / "imports").mkdir(exist_ok=True)
    (folder / f"imports/{marker:08x}.json").write_bytes(content)
    try:
        found = BackupStore(folder).journals(marker)
    except ProjectError as error:
        check(error)
    else:
        assert [one.marker for one in found] == [marker]
        BackupStore(folder).write(found[0])
        assert BackupStore(folder).journals(marker) == found


def check_announcement(path: Path) -> None:
    """Read the file as the announcement of a virtual board."""
    content = path.read_bytes()
    assert len(announced_boards()) <= 1
    assert not path.exists() or path.read_bytes() == content


class _Deaf:
    def data(self, chunk: bytes, /) -> None:
        pass

    def lost(self, error: Exception | None, /) -> None:
        pass
