"""Marks: what received bytes show about firmware, bridge or line that are not quite those of the document.

Rejected bytes are compared with the frames that they nearly are. A mark needs the same difference more than once, or a
change that turns bytes into right frames: a damaged frame alone says nothing.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from itertools import islice
from typing import NamedTuple

from msgspec import Struct

from servolink.errors import quote
from servolink.protocol import (
    HEADER,
    HEADER_SIZE,
    MAGIC,
    OVERHEAD,
    PACKETS,
    ByteOrder,
    Request,
    checksum,
    layout,
)

LONG_PAUSE = 0.4
"""Seconds inside a frame after which a frame comes in parts."""

_BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_LONGEST_SHOWN = 48  # bytes of a frame
_FIRST = 16  # bytes shown of a line
_LEAST_ALIKE = 2  # rejected frames with the same difference
_LEAST_UNEXPLAINED = 3  # frames with a wrong sum by no known rule, beside no right one
_MOST_PIECES = 64
_MOST_EXTRA = 3  # bytes behind a frame that may belong to the next one
_LEAST_SETTINGS = 24  # bytes that show parity by themselves
_OF_ALL_FRAMES = {"checksum", "length", "first bytes"}
"""Subjects of which a few frames say nothing: they may be damaged."""
_XON_XOFF = {0x11, 0x13}


class Mark(Struct, frozen=True):
    """Difference from the document, in words."""

    name: str
    """Subject in a word or two, such as `checksum`."""
    text: str
    """Observation, a sentence without its subject: "sends frames ..."."""
    meaning: str
    remedy: str
    is_bridge: bool = False
    """Whether something on the way changes bytes, so that a missing response says nothing of the board."""


class FoundFrame(NamedTuple):
    """Frame with a known id and the right sum."""

    packet_id: int
    start: int
    end: int
    fits: bool
    """Whether the length of its content is one of the document."""


def frames_in(data: bytes, byte_order: ByteOrder) -> Iterator[FoundFrame]:
    """Yield each frame with a known id and the right sum."""
    at = data.find(MAGIC)
    while 0 <= at <= len(data) - OVERHEAD:
        _, packet_id, length = HEADER[byte_order].unpack_from(data, at)
        end = at + length + OVERHEAD
        if packet_id in PACKETS and end <= len(data) and checksum(data[at : end - 1]) == data[end - 1]:
            yield FoundFrame(packet_id, at, end, _admits(packet_id, length))
            at = end - 1
        at = data.find(MAGIC, at + 1)


def has_id_of_request(packet_id: int, size: int) -> bool:
    """Return whether a content of `size` bytes is that of the response, under the id of its request."""
    declared = PACKETS[packet_id]
    return issubclass(declared, Request) and not _admits(packet_id, size) and _admits(packet_id + 1, size)


def is_longer(frame: FoundFrame) -> bool:
    """Return whether a frame has more content than in the document, which can be ignored."""
    size = frame.end - frame.start - OVERHEAD
    rule = layout(PACKETS[frame.packet_id], "little").rule
    return not frame.fits and size > rule.base and not has_id_of_request(frame.packet_id, size)


def outside_frames(data: bytes, byte_order: ByteOrder) -> list[bytes]:
    """Return the spans of bytes between frames with a known id and the right sum, empty ones left out."""
    spans, at = list[bytes](), 0
    for frame in frames_in(data, byte_order):
        spans.append(data[at : frame.start])
        at = max(at, frame.end)
    return [span for span in (*spans, data[at:]) if span]


def ends_inside(data: bytes) -> bool:
    """Return whether the last frame in `data` is not complete, in either byte order."""
    rest = data[max(data.rfind(MAGIC), 0) :]
    if any(data.endswith(MAGIC[:size]) for size in range(2, len(MAGIC))):
        return True
    if not rest.startswith(MAGIC):
        return False
    if len(rest) < HEADER_SIZE:
        return True
    headers = [HEADER[byte_order].unpack_from(rest) for byte_order in _BYTE_ORDERS]
    return any(packet_id in PACKETS and len(rest) < length + OVERHEAD for _, packet_id, length in headers)


def unread(data: bytes, byte_order: ByteOrder) -> list[bytes]:
    """Return the spans of bytes that are no frames of the document, without the zeros behind frames."""
    spans, at = list[bytes](), 0
    for frame in frames_in(data, byte_order):
        if frame.fits:
            spans.append(data[at : frame.start])
            at = max(at, frame.end)
    return [span for span in (*spans, data[at:]) if span.strip(b"\0")]


def described_bytes(data: bytes, byte_order: ByteOrder) -> str:
    """Return what a board sends beside frames, such as "sends text, 'ERR'"."""
    if marks := marks_in(data, byte_order):
        return marks[0].text
    rest = b"".join(unread(data, byte_order))
    text = rest.decode("utf-8", "replace").strip()
    is_text = text and all(each.isprintable() or each.isspace() for each in text) and "\ufffd" not in text
    return f"sends text, {quote(text[:_LONGEST_SHOWN])}" if is_text else f"sends {shown(rest)}"


def marks_in(data: bytes, byte_order: ByteOrder) -> list[Mark]:
    """Return the marks in received bytes, the ones that say the most first; none in right frames."""
    found = [*_changed_bytes(data, byte_order), *_odd_frames(data, byte_order)]
    return found or list(_odd_rest(data, byte_order))


def shown(frame: bytes) -> str:
    """Return a frame in hexadecimal digits, cut if it is long."""
    return frame[:_LONGEST_SHOWN].hex(" ") + (" ..." if len(frame) > _LONGEST_SHOWN else "")


def _admits(packet_id: int, length: int) -> bool:
    return layout(PACKETS[packet_id], "little").rule.admits(length)


# --- bridges that change bytes ---------------------------------------------------------------------------------------

_TELNET = re.compile(rb"\xff(?:(\xff)|[\xfb-\xfe].|[\xf0-\xfa])", re.DOTALL)
_NEGOTIATION = re.compile(rb"\xff[\xfb-\xfe][\x00-\x32].?")
_RAW_MODE = "set the serial server or bridge to raw TCP, without telnet, RFC 2217 or any conversion"
_RAW_OR_TELNET = f"{_RAW_MODE}\nor, if it speaks RFC 2217: write rfc2217:// in place of tcp://"
_TRANSPARENT = "set the bridge, terminal driver or adapter to pass all bytes unchanged (raw, binary, transparent)"

_DIRECTION = "use a two-wire adapter that turns its direction in time, or lengthen its delay before it sends"


def _without_telnet(data: bytes) -> bytes:
    return _TELNET.sub(lambda found: found[1] or b"", data)


def _from_latin(data: bytes) -> bytes:
    return data.decode("utf-8", "ignore").encode("latin-1", "ignore")


def _from_hex(data: bytes) -> bytes:
    digits = bytes(each for each in data if each in b"0123456789abcdefABCDEF")
    return bytes.fromhex(digits[: len(digits) // 2 * 2].decode("ascii"))


def _without_slip(data: bytes) -> bytes:
    return data.replace(b"\xc0", b"").replace(b"\xdb\xdc", b"\xc0").replace(b"\xdb\xdd", b"\xdb")


def _without_hdlc(data: bytes) -> bytes:
    return re.sub(rb"\x7d(.)", lambda found: bytes((found[1][0] ^ 0x20,)), data.replace(b"\x7e", b""), flags=re.DOTALL)


def _with_first_bytes(data: bytes) -> bytes:
    return re.sub(rb"(?<!\x13)\x4c\x05\x1d", MAGIC, data)


def _swapped(data: bytes) -> bytes:
    return bytes(data[at ^ 1] for at in range(len(data) & ~1))


_CHANGES: tuple[tuple[str, str, Callable[[bytes], bytes], str], ...] = (
    ("telnet", "doubles ff, as a serial server in telnet mode (RFC 2217) does", _without_telnet, _RAW_OR_TELNET),
    ("line ends", "puts 0d before each 0a", lambda data: data.replace(b"\r\n", b"\n"), _TRANSPARENT),
    ("line ends", "puts 0a behind each 0d", lambda data: data.replace(b"\r\n", b"\r"), _TRANSPARENT),
    ("line ends", "puts 00 behind each 0d", lambda data: data.replace(b"\r\0", b"\r"), _TRANSPARENT),
    ("line ends", "changes 0d to 0a", lambda data: data.replace(b"\n", b"\r"), _TRANSPARENT),
    ("line ends", "changes 0a to 0d", lambda data: data.replace(b"\r", b"\n"), _TRANSPARENT),
    ("text bridge", "sends bytes above 7f as text in UTF-8", _from_latin, _TRANSPARENT),
    ("text bridge", "sends bytes as hexadecimal digits", _from_hex, _TRANSPARENT),
    ("escaping", "frames and escapes bytes with c0 and db (SLIP)", _without_slip, _TRANSPARENT),
    ("escaping", "frames and escapes bytes with 7e and 7d (PPP, HDLC)", _without_hdlc, _TRANSPARENT),
    ("first bytes", "loses the first byte of each frame", _with_first_bytes, _DIRECTION),
    ("swapped bytes", "swaps the two bytes of each pair", _swapped, _TRANSPARENT),
    (
        "inverted bits",
        "sends each byte with inverted bits",
        lambda data: bytes(255 - each for each in data),
        "use an adapter with the right signal levels (RS-232, TTL, RS-485 A and B)",
    ),
    (
        "bit order",
        "sends the bits of each byte in reverse order",
        lambda data: bytes(int(f"{each:08b}"[::-1], 2) for each in data),
        _TRANSPARENT,
    ),
)
"""Changes of bytes on their way: subject, observation, the way back, and remedy."""


def _changed_bytes(data: bytes, byte_order: ByteOrder) -> Iterator[Mark]:
    """Look for a bridge: a way back from which more right frames come."""
    right = _right_frames(data, byte_order)
    for name, text, back, remedy in _CHANGES:
        restored = back(data)
        gained = _right_frames(restored, byte_order) - right if restored != data else 0
        if gained >= (right + 1 if name in _OF_ALL_FRAMES else _LEAST_ALIKE) or (gained and not right):
            odd = LineBytes(data, byte_order).first()
            yield _bridge(name, f"{text}: {gained} frames are right without that, such as {odd}", remedy)
            return
    if _NEGOTIATION.match(data):
        yield _bridge("telnet", f"begins with a telnet negotiation (RFC 2217), {shown(data[:12])}", _RAW_OR_TELNET)
    elif data.count("\ufffd".encode()) >= _LEAST_ALIKE:
        yield _bridge("text bridge", "sends the mark for undecodable text, ef bf bd, in place of bytes", _TRANSPARENT)
    elif parity := _parity(data):
        yield Mark(
            "serial settings",
            f"sends bytes with {parity}",
            "the other end has 7 data bits or parity, and servolink has 8 data bits and no parity (8N1)",
            "set the board or the serial server to 8 data bits, no parity, 1 stop bit",
        )


def _bridge(name: str, text: str, remedy: str) -> Mark:
    return Mark(
        name, text, "something between this computer and the board changes the bytes of frames", remedy, is_bridge=True
    )


def _right_frames(data: bytes, byte_order: ByteOrder) -> int:
    return sum(frame.fits for frame in frames_in(data, byte_order))


def _parity(data: bytes) -> str:
    """Return the parity that stands in bit 7 of all bytes, or that bit 7 is missing; empty without such evidence."""
    low = bytes(each & 0x7F for each in data)
    ones = Counter(each.bit_count() % 2 for each in data)
    hidden = low.count(MAGIC) > data.count(MAGIC) and not data.count(MAGIC)
    if not hidden and (len(data) < _LEAST_SETTINGS or len(set(low)) < len(MAGIC) or len(ones) > 1):
        return ""
    if len(ones) == 1:
        return "even parity in bit 7" if 0 in ones else "odd parity in bit 7"
    return "another use of bit 7" if hidden else ""


# --- frames that differ from those of the document -------------------------------------------------------------------


def _xor(body: bytes) -> int:
    total = 0
    for each in body:
        total ^= each
    return total


_SUMS: tuple[tuple[str, Callable[[bytes], int]], ...] = (
    ("the sum of the content only", lambda body: sum(body[HEADER_SIZE:])),
    ("the sum without the four bytes of the magic", lambda body: sum(body[len(MAGIC) :])),
    ("the sum of length and content", lambda body: sum(body[HEADER_SIZE - 2 :])),
    ("the complement of the sum", lambda body: ~sum(body)),
    ("the negative sum", lambda body: -sum(body)),
    ("the exclusive or of all bytes", _xor),
    ("the exclusive or of the content", lambda body: _xor(body[HEADER_SIZE:])),
    ("the exclusive or without the magic", lambda body: _xor(body[len(MAGIC) :])),
    ("always 0", lambda body: 0),
)
_DROPPED = {
    0x11: "XON, 11",
    0x13: "XOFF, 13",
    0x0D: "0d",
    0x0A: "0a",
    0x00: "00",
    0xFF: "ff",
    0x1B: "1b",
    0x03: "03",
    0x7F: "7f",
}
_FIRMWARE = "the firmware, or a bridge, has another form of frames; no setting of servolink changes that"
_UPDATE = "update the firmware, or show the frame to its maker"


class _FramePiece(NamedTuple):
    """Bytes from a magic to the next one, that are no right frame."""

    data: bytes
    packet_id: int
    length: int
    """Length of the content, as the field says."""

    @property
    def content_size(self) -> int:
        return len(self.data) - OVERHEAD


def _pieces(data: bytes, byte_order: ByteOrder) -> Iterator[_FramePiece]:
    right = {frame.start: frame.end for frame in frames_in(data, byte_order) if frame.fits}
    at = data.find(MAGIC)
    while at >= 0:
        following = data.find(MAGIC, right.get(at, at + len(MAGIC)))
        piece = data[at : following if following >= 0 else len(data)]
        if at not in right and len(piece) >= OVERHEAD:
            _, packet_id, length = HEADER[byte_order].unpack_from(piece)
            yield _FramePiece(piece, packet_id, length)
        at = following


def _odd_frames(data: bytes, byte_order: ByteOrder) -> Iterator[Mark]:
    """Look for the difference that most rejected frames have in common."""
    found, different = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    examples = dict[tuple[str, str], bytes]()
    pieces = Counter(islice(_pieces(data, byte_order), _MOST_PIECES))
    arrived = {each for frame in frames_in(data, byte_order) if frame.fits for each in data[frame.start : frame.end]}
    for piece, times in pieces.items():
        if difference := _difference(piece, arrived):
            found[difference] += 1 if difference[0] == "checksum" else times  # equal frames prove no rule
            different[difference] += 1
            examples.setdefault(difference, piece.data)
    rights = _right_frames(data, byte_order)
    for (name, text), count in found.most_common():
        least = _LEAST_UNEXPLAINED if name == "checksum" and not text else _LEAST_ALIKE
        if count < least or (name in _OF_ALL_FRAMES and count <= rights):
            continue
        if name == "dropped bytes" and not rights and different[name, text] < _LEAST_ALIKE:
            continue  # by chance: a byte that is dropped leaves the frames right that are without it
        observation = f"sends frames of this protocol, but {text or 'the checksum is not the one of the document'}"
        example = f"; {count} frames, such as {shown(examples[name, text])}"
        if name == "dropped bytes":
            yield _bridge(name, observation + example, f"{_TRANSPARENT}\nswitch off software flow control (XON/XOFF)")
        else:
            yield Mark(name, observation + example, _FIRMWARE, _UPDATE)
        return


def _difference(piece: _FramePiece, arrived: Collection[int]) -> tuple[str, str] | None:
    """Return subject and text of what makes a piece no right frame; None for damage.

    Bytes in `arrived` are in right frames, and so not missing on the way.
    """
    for extra in range(min(_MOST_EXTRA, piece.content_size) + 1):
        whole = piece.data[: len(piece.data) - extra]
        if checksum(whole[:-1]) == whole[-1] and (found := _with_right_sum(piece, len(whole) - OVERHEAD)):
            return found
    if piece.packet_id not in PACKETS or not _admits(piece.packet_id, piece.length):
        return None
    end = piece.length + OVERHEAD
    if len(piece.data) >= end:
        return "checksum", _rule_of(piece.data[:end])
    missing = end - len(piece.data)
    if missing > _MOST_EXTRA:
        return "cut frames", f"frames end after {len(piece.data)} bytes"
    lost = (piece.data[-1] - sum(piece.data[:-1])) % 256
    return next(
        (
            ("dropped bytes", f"each {name} is missing on the way")
            for value, name in _DROPPED.items()
            if value not in arrived and missing * value % 256 == lost
        ),
        ("checksum", "each ends before its checksum") if missing == 1 else None,
    )


def _rule_of(frame: bytes) -> str:
    """Return how the checksum of a frame may be made; empty if no known way fits."""
    rule = next((text for text, rule in _SUMS if rule(frame[:-1]) % 256 == frame[-1]), "")
    return rule and f"the checksum is not the one of the document: it is {rule}"


def _with_right_sum(piece: _FramePiece, size: int) -> tuple[str, str] | None:
    """Return what is wrong with a piece whose checksum is right for a content of `size` bytes."""
    packet_id, length = piece.packet_id, piece.length
    if packet_id not in PACKETS:
        if length != size:
            return None
        swapped = packet_id >> 8 | (packet_id & 0xFF) << 8
        is_swapped = swapped in PACKETS
        return (
            "ids",
            f"the ids are {'in the other byte order than the length' if is_swapped else 'none of the document'}",
        )
    if length == size:
        if has_id_of_request(packet_id, size):
            return "ids", "each response has the id of its request"
        rule = layout(PACKETS[packet_id], "little").rule
        sizes = f"{rule.base} + {rule.unit} for each record" if rule.unit else str(rule.base)
        return "contents", f"packet {packet_id} has {size} bytes of content, and {sizes} in the document"
    if not (_admits(packet_id, size) or _admits(packet_id, length)):
        return None
    swapped = length >> 8 | (length & 0xFF) << 8
    if swapped == size:
        return "length", "the length is in the other byte order than the id"
    how = {OVERHEAD: "the whole frame", HEADER_SIZE: "header and content", 1: "content and checksum"}
    return "length", f"the length counts {how.get(length - size, 'something other than the content')}"


# --- bytes between frames --------------------------------------------------------------------------------------------


def _odd_rest(data: bytes, byte_order: ByteOrder) -> Iterator[Mark]:
    """Look for what the bytes between frames have in common."""
    spans = unread(data, byte_order)
    rest = b"".join(spans)
    if len(rest) >= _LEAST_ALIKE and set(rest) <= _XON_XOFF:
        yield Mark(
            "flow control",
            f"sends {shown(spans[0][:8])} between frames: XOFF (13) and XON (11)",
            "the other end has software flow control, which swallows or adds these two bytes",
            "switch off software flow control (XON/XOFF) at the board, adapter or serial server",
        )


class LineBytes(NamedTuple):
    """Bytes of one direction of a line, as a verdict looks at them."""

    data: bytes
    byte_order: ByteOrder = "little"

    def frames(self) -> list[FoundFrame]:
        """Return the frames with a known id and the right sum."""
        return list(frames_in(*self))

    def marks(self) -> list[Mark]:
        """Return the marks, the ones that say the most first."""
        return marks_in(*self)

    def unread(self) -> list[bytes]:
        """Return the spans of bytes that are no frames of the document, without the zeros behind frames."""
        return unread(*self)

    def described(self) -> str:
        """Return what a board sends beside frames, such as "sends text, 'ERR'"."""
        return described_bytes(*self)

    def ends_inside(self) -> bool:
        """Return whether the last frame is not complete."""
        return ends_inside(self.data)

    def first(self) -> str:
        """Return the first bytes outside of frames in hexadecimal digits, else the first bytes."""
        return shown(next(iter(self.unread()), self.data)[:_FIRST])
