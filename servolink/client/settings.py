"""Commands of chapter 3.1: transmission mode, stored data, memory, battery, test data."""

from __future__ import annotations

from servolink.client.chapter import Chapter
from servolink.client.link import Link
from servolink.errors import Rejected
from servolink.protocol.settings import (
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    SendDummyDataRequest,
    TransmissionModeSettingRequest,
)


class Settings(Chapter):
    """What concerns the whole board."""

    _mode: int | None = None  # the transmission mode that was set on this connection

    async def set_transmission_mode(self, mode: int) -> None:
        """Set mode 1, this protocol, or 0, the old one, which this library does not speak (3.1.1)."""
        await _set_mode(self._link, mode)
        self._mode = mode

    async def _speak_this_protocol(self, link: Link) -> None:
        """Set mode 1 on a new link, if any was set on the one before it: in mode 0 no board says which it is."""
        if self._mode is not None:
            await _set_mode(link, 1)

    async def _restore_mode(self, link: Link) -> None:
        """Set on a new link, which leads to the same board, the transmission mode that was set before."""
        if self._mode not in (None, 1):
            await _set_mode(link, self._mode)

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2); nothing else is sent before it is answered."""
        with self._identity.changing(self._link, 0):
            await self._do(ClearAllDataRequest(), "its data was not deleted")
        self._identity.may_have(0)  # boards differ in whether they keep it

    async def memory(self) -> QueryMemorySizeResponse:
        """Return free and total memory in bytes, `size` and `total_size` (None on boards that do not tell) (3.1.3)."""
        return await self.request(QueryMemorySizeRequest())

    async def battery(self) -> float:
        """Return the remaining charge in percent, in steps of 0.1 (3.1.4)."""
        return (await self.request(QueryRemainPowerRequest())).permil / 10

    async def send_dummy_data(self, data: bytes) -> None:
        """Send up to 65,535 bytes that the board throws away (3.1.5)."""
        await self.send(SendDummyDataRequest(data))


async def _set_mode(link: Link, mode: int) -> None:
    request = TransmissionModeSettingRequest(mode)
    if (answer := await link.request(request)).result != mode:
        raise Rejected(f"the board was asked for mode {mode} and is in mode {answer.result}", request)
