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
        request = TransmissionModeSettingRequest(mode)
        if (answer := await self.request(request)).result != mode:
            raise Rejected(f"the board was asked for mode {mode} and is in mode {answer.result}", request)
        self._mode = mode

    async def _restore_mode(self, link: Link) -> None:
        """Set on a new link the transmission mode that was set on the one before it."""
        if self._mode is not None:
            await link.request(TransmissionModeSettingRequest(self._mode))

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
