"""Reasons why a board does not work: examination, learning, spying on a line, Wireshark."""

from __future__ import annotations

from servolink.doctor.contact import AFTER_RESET, ProbeResponse, ProbeResult, probe
from servolink.doctor.environment import check_holders
from servolink.doctor.examination import Report, checks_before_opening, examine
from servolink.doctor.finding import Finding
from servolink.doctor.learn_board import Learnt, learn_by_asking, learn_by_writing
from servolink.doctor.learn_line import SharedTransport, TrialLine
from servolink.doctor.learn_motion import interval_finding, plan_movement
from servolink.doctor.learn_queries import Contact, make_contact
from servolink.doctor.learn_trial import Trial, connected
from servolink.doctor.permissions import rules, rules_for
from servolink.doctor.spy.learning import Learner, Passed
from servolink.doctor.spy.relay import Relay
from servolink.doctor.spy.verdict import verdict
from servolink.doctor.spy.watching import Watcher
from servolink.doctor.system import ListedUsbDevice, SystemFacts
from servolink.doctor.wireshark.dissector import dissector, install

__all__ = [
    # examination
    "ListedUsbDevice",
    "rules",
    "rules_for",
    "Finding",
    "AFTER_RESET",
    "ProbeResponse",
    "ProbeResult",
    "Report",
    "SystemFacts",
    "check_holders",
    "checks_before_opening",
    "examine",
    "probe",
    # learning
    "Contact",
    "Learnt",
    "SharedTransport",
    "Trial",
    "TrialLine",
    "connected",
    "interval_finding",
    "learn_by_asking",
    "learn_by_writing",
    "make_contact",
    "plan_movement",
    # spy
    "Learner",
    "Passed",
    "Relay",
    "Watcher",
    "verdict",
    # Wireshark
    "dissector",
    "install",
]
