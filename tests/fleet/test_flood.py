"""A flood from the broker: stops reach their board, the memory stays flat, and commands are carried out again."""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from pathlib import Path
from statistics import median

import pytest

from servolink.errors import RequestError
from servolink.fleet import Fleet, connect
from servolink.hub import serve_board
from tests.fleet.bridged import LIMIT, run
from tests.fleet.mosquitto import Broker, needs_broker
from tests.processes import start_async

pytestmark = [*needs_broker, pytest.mark.slow, pytest.mark.usefixtures("user")]

PROGRAM = str(Path(__file__).with_name("flooding.py"))
RATE, SECONDS = 20_000, 10.0
"""Messages a second, and how long."""
LEAST = 0.5  # of that rate, on a busy machine
STOPPED = 0.1  # seconds, at the median: on a busy machine a stop may wait for a processor
GROWTH = 1.25  # of the memory of the bridge, from the middle of the flood to its end
PATIENCE = 5.0  # seconds for an answer: the broker drops what comes while too much waits for the bridge


def memory(process: asyncio.subprocess.Process) -> int:
    """Return the resident memory of a program in KiB."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    return int(status.partition("VmRSS:")[2].split()[0])


async def is_answered(fleet: Fleet) -> bool:
    """Return whether the bridge carries out a command."""
    with suppress(RequestError):  # also while it is `busy`
        await fleet.call("rex", "battery", patience=PATIENCE)
        return True
    return False


@pytest.mark.parametrize("qos", [0, 1])
@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory of a program from /proc")
def test_stops_pass_a_flood_and_the_memory_stays_flat(broker: Broker, qos: int) -> None:
    async def main() -> None:
        join = [sys.executable, "-m", "servolink", "fleet", "join", broker.url, "rex", "--hz", "0"]
        flood = [PROGRAM, str(broker.port), "servolink/rex/cmd", str(qos), str(RATE), str(SECONDS)]
        async with serve_board("virtual://?servos=1", name="rex"), connect(broker.url, groups={}) as fleet:
            bridge = await start_async(*join)
            assert bridge.stdout is not None
            assert (await bridge.stdout.readline()).startswith(b"joined")
            await fleet.list()
            flooding = asyncio.create_task((await start_async(sys.executable, *flood)).communicate())
            seconds, sizes = [], []
            while not flooding.done():
                seconds.append((await fleet.stop(patience=LIMIT)).stopped["rex"])
                sizes.append(memory(bridge))
                await asyncio.wait((flooding,), timeout=SECONDS / 20)
            sent = int((await flooding)[0])
            print(f"{sent / SECONDS:.0f} a second; stops after {[round(1000 * each) for each in seconds]} ms")
            print(f"memory {sizes} KiB")
            assert sent > LEAST * RATE * SECONDS
            assert median(seconds) < STOPPED
            assert sizes[-1] < GROWTH * sizes[len(sizes) // 2]
            async with asyncio.timeout(LIMIT):
                while not await is_answered(fleet):
                    pass
            bridge.terminate()
            await bridge.wait()

    run(main())
