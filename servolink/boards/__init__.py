"""Boards that are here: search, names, running hubs, and the profile of each board."""

from __future__ import annotations

from servolink.boards.announcements import announced
from servolink.boards.announcements import candidates as announced_boards
from servolink.boards.hubs import HubClaim, hub_of
from servolink.boards.hubs import candidates as running_hubs
from servolink.boards.names import Alias, Aliases, Resolved, resolve_board, resolve_url
from servolink.boards.normals import BoardNormals, ServoNormal
from servolink.boards.profile import (
    BoardIdentityRecord,
    BoardProfile,
    BoardSettings,
    Confidence,
    Evidence,
    Measured,
    ProfileInUse,
    SafetyLimits,
)
from servolink.boards.searching import (
    NO_BOARD_FOUND,
    SearchResult,
    boards,
    discover,
    find_devices,
    identity_of,
    only,
    search,
)
from servolink.boards.store import ProfileFile, format_profile, parse_profile, setting_from_text
from servolink.boards.toml_text import TextError, parse_toml, read_toml

__all__ = [
    # search and addresses
    "NO_BOARD_FOUND",
    "Resolved",
    "SearchResult",
    "boards",
    "discover",
    "find_devices",
    "identity_of",
    "only",
    "resolve_board",
    "resolve_url",
    "search",
    # names
    "Alias",
    "Aliases",
    # hubs on this machine
    "HubClaim",
    "announced",
    "announced_boards",
    "running_hubs",
    "hub_of",
    # profiles
    "BoardIdentityRecord",
    "BoardNormals",
    "BoardProfile",
    "BoardSettings",
    "Confidence",
    "Evidence",
    "Measured",
    "ProfileFile",
    "ProfileInUse",
    "SafetyLimits",
    "ServoNormal",
    "TextError",
    "format_profile",
    "parse_profile",
    "parse_toml",
    "read_toml",
    "setting_from_text",
]
