"""Boards on many machines, through an MQTT broker.

async with servolink.fleet.connect("mqtt://teacher.local") as fleet:
    await fleet.run("Wave", on="front,rex")
    await fleet.stop()
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from servolink.support import lazy_names

if TYPE_CHECKING:
    from servolink.fleet.access import BrokerAccess as BrokerAccess
    from servolink.fleet.access import BrokerAddress as BrokerAddress
    from servolink.fleet.access import parse_broker as parse_broker
    from servolink.fleet.client import Fleet as Fleet
    from servolink.fleet.client import connect as connect
    from servolink.fleet.controller import Controller as Controller
    from servolink.fleet.each import Outcomes as Outcomes
    from servolink.fleet.home_assistant import HomeAssistant as HomeAssistant
    from servolink.fleet.join import LocalBoard as LocalBoard
    from servolink.fleet.join import LocalFleet as LocalFleet
    from servolink.fleet.join import local_boards as local_boards
    from servolink.fleet.policy import BoardPolicy as BoardPolicy
    from servolink.fleet.policy import FleetFile as FleetFile
    from servolink.fleet.policy import PolicyFile as PolicyFile
    from servolink.fleet.policy import load_fleet_file as load_fleet_file
    from servolink.fleet.roster import MOST_BOARDS as MOST_BOARDS
    from servolink.fleet.roster import BoardSeen as BoardSeen
    from servolink.fleet.roster import Roster as Roster
    from servolink.fleet.stop_boards import Stopped as Stopped
    from servolink.fleet.stop_boards import stop_all as stop_all
    from servolink.fleet.together import RanTogether as RanTogether
    from servolink.fleet.together import run_by_name as run_by_name
    from servolink.fleet.topics import METHODS as METHODS
    from servolink.fleet.topics import MOST_BYTES as MOST_BYTES
    from servolink.fleet.topics import OFFLINE as OFFLINE
    from servolink.fleet.topics import ONLINE as ONLINE
    from servolink.fleet.topics import PREFIX as PREFIX
    from servolink.fleet.topics import SENT as SENT
    from servolink.fleet.topics import BoardNow as BoardNow
    from servolink.fleet.topics import BoardResult as BoardResult
    from servolink.fleet.topics import BoardTopic as BoardTopic
    from servolink.fleet.topics import Echoed as Echoed
    from servolink.fleet.topics import ServosNow as ServosNow
    from servolink.fleet.topics import Started as Started
    from servolink.fleet.topics import Stop as Stop
    from servolink.fleet.topics import StopOver as StopOver
    from servolink.fleet.topics import Stored as Stored
    from servolink.fleet.topics import Topics as Topics
    from servolink.fleet.topics import TransferStep as TransferStep
    from servolink.fleet.topics import schema as schema
    from servolink.fleet.transfer import BoardPlan as BoardPlan
    from servolink.fleet.transfer import Transfer as Transfer
else:
    _MODULES = {
        # a fleet
        "client": (
            "Fleet",
            "connect",
        ),
        "roster": (
            "BoardSeen",
            "MOST_BOARDS",
            "Roster",
        ),
        "each": ("Outcomes",),
        "policy": (
            "BoardPolicy",
            "FleetFile",
            "PolicyFile",
            "load_fleet_file",
        ),
        # runs, stops and transfers
        "together": (
            "RanTogether",
            "run_by_name",
        ),
        "stop_boards": (
            "Stopped",
            "stop_all",
        ),
        "transfer": (
            "BoardPlan",
            "Transfer",
        ),
        # boards of this machine
        "join": (
            "LocalBoard",
            "LocalFleet",
            "local_boards",
        ),
        "home_assistant": ("HomeAssistant",),
        "controller": ("Controller",),
        # the broker and its topics
        "access": (
            "BrokerAccess",
            "BrokerAddress",
            "parse_broker",
        ),
        "topics": (
            "BoardNow",
            "BoardTopic",
            "Echoed",
            "METHODS",
            "MOST_BYTES",
            "OFFLINE",
            "ONLINE",
            "PREFIX",
            "BoardResult",
            "SENT",
            "ServosNow",
            "Started",
            "TransferStep",
            "Stop",
            "StopOver",
            "Stored",
            "Topics",
            "schema",
        ),
    }
    __all__ = [name for names in _MODULES.values() for name in names]
    __getattr__ = lazy_names(__name__, _MODULES, extra="fleet")
