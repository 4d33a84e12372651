"""The client's side of a board that a hub shares (see `servolink.control.share`)."""

from __future__ import annotations

from typing import Any

import msgspec

from servolink.connection.options import ConnectionOptions
from servolink.control.share import ShareTransport
from servolink.errors import OpenError
from servolink.profiles.profile import BoardProfile, ProfileInUse

_OF_THE_BOARD = ("caption_encoding", "depth", "write_depth")
"""The options in a profile that count through a hub too; it settles the others with the board."""


async def join_hub(
    transport: ShareTransport, given: dict[str, Any], profile: ProfileInUse | None
) -> tuple[ConnectionOptions, ProfileInUse | None]:
    """Greet the hub; return the options of the connection, of which some are `given`, and the profile of the board.

    That is `profile` or, if it is None, the hub's. Raise OpenError, and leave nothing open, if the hub lets nobody in.
    """
    transport.greeting.byte_order = given.get("byte_order", "little")
    welcome = await transport.greet()
    try:
        found = msgspec.json.decode(welcome.profile, type=BoardProfile | None)
        if profile is None and found is not None:
            profile = ProfileInUse(welcome.name, found)
        options: dict[str, Any] = {"patience": welcome.patience}
        if profile is not None:
            known = {name: getattr(profile.settings, name) for name in _OF_THE_BOARD}
            options |= {name: value for name, value in known.items() if value is not None}
        return ConnectionOptions(**(options | given)), profile
    except msgspec.MsgspecError as error:
        await transport.close()
        raise OpenError(f"{transport.url}: the hub has a profile of another version: {error}") from error
    except BaseException:
        await transport.close()
        raise
