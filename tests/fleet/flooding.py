"""Sends commands as fast as it is told to, and prints how many: `flooding.py PORT TOPIC QOS RATE SECONDS`."""

from __future__ import annotations

import socket
import struct
import sys
from contextlib import suppress
from time import monotonic, sleep

CONNECT = b"\x10\x11\0\4MQTT\4\2\0\x3c\0\5flood"
_BATCHES = 100  # a second


def packet(topic: bytes, number: int, qos: int) -> bytes:
    """Return a command with an id of its own, in a message of MQTT 3.1.1."""
    packet_id = struct.pack("!H", number % 0xFFFF + 1) if qos else b""
    payload = f'{{"id":"f{number}","method":"battery"}}'.encode()
    body = struct.pack("!H", len(topic)) + topic + packet_id + payload
    assert len(body) < 0x80
    return bytes((0x30 | qos << 1, len(body))) + body


def flood(port: int, topic: str, qos: int, rate: int, seconds: float) -> int:
    """Send `rate` commands a second. Return how many the broker took."""
    sent = 0
    with socket.create_connection(("127.0.0.1", port)) as broker:
        broker.sendall(CONNECT)
        assert broker.recv(4)[0] == 0x20
        begun = monotonic()
        while (now := monotonic() - begun) < seconds:
            due = int(now * rate)
            broker.sendall(b"".join(packet(topic.encode(), number, qos) for number in range(sent, due)))
            sent = due
            with suppress(BlockingIOError):  # confirmations, which would fill the connection
                broker.recv(1 << 20, socket.MSG_DONTWAIT)
            sleep(1 / _BATCHES)
    return sent


if __name__ == "__main__":
    _, at, where, with_qos, wanted, lasts = sys.argv
    print(flood(int(at), where, int(with_qos), int(wanted), float(lasts)))
