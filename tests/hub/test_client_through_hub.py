"""Scenarios of the client through a hub: names, records, motion, limits and waiting are as on the board itself."""

from __future__ import annotations

import inspect
from types import ModuleType

import pytest

from tests.client import (
    piped_board,
    test_angle_units,
    test_arriving,
    test_board_servos,
    test_captions,
    test_limited_runs,
    test_new_records,
    test_playing,
    test_soft_start,
    test_waiting,
)
from tests.hub.through_hub import connect_through_hub

MODULES = (
    test_arriving,
    test_limited_runs,
    test_captions,
    test_new_records,
    test_playing,
    test_board_servos,
    test_soft_start,
    test_angle_units,
    test_waiting,
)
ONLY_DIRECT = {
    # What the library sends in which turn of the loop, and when units are set, is up to the hub.
    "test_move_sends_all_targets_in_one_movement_and_returns_when_sent",
    "test_move_by_speed_reads_the_angles_first_and_returns_the_longest_time",
    "test_a_movement_that_came_first_goes_first_in_the_old_unit",
    "test_an_angle_is_asked_for_again_if_a_unit_was_sent_before_its_answer_came",
    "test_the_unit_is_set_by_the_next_command_when_the_first_was_cancelled_or_failed",
    "test_the_unit_is_set_once_and_only_before_the_first_command_with_an_angle",
    "test_units_are_left_alone_if_so_asked_and_angles_are_then_plain_numbers",
    "test_with_limits_everything_that_runs_is_read_once",
    "test_without_limits_only_the_list_of_macros_and_once_the_servos_are_read",
    # Whoever is behind a hub is not told that the board is lost or silent: it is not answered.
    "test_a_board_that_does_not_answer_about_a_servo_it_does_not_have_stays_connected",
    "test_a_lost_connection_ends_a_run",
    "test_a_lost_connection_ends_it",
    "test_the_loss_of_the_board_ends_it",
    "test_the_state_of_another_servo_is_never_returned",
    "test_whether_servos_have_arrived_is_unknown_if_the_board_falls_silent",
    # A transport cannot be connected again.
    "test_after_a_reconnect_all_poses_are_unknown",
    "test_units_of_single_servos_are_set_again_where_that_of_all_is_not_known",
    # These check arguments before anything is connected, or read numbers of a profile in the test's own hand.
    "test_a_soft_start_that_is_no_speed_is_refused",
    "test_the_interval_unit_counts_for_moves_and_stored_records",
}


def _add_tests_of(module: ModuleType) -> None:
    for name, test in vars(module).items():
        if name.startswith("test_") and inspect.isfunction(test) and name not in ONLY_DIRECT:
            globals()[f"{name}__{module.__name__.rpartition('.')[2]}"] = test


for _module in MODULES:
    _add_tests_of(_module)


@pytest.fixture(autouse=True)
def _connects_through_a_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (piped_board, *MODULES):
        if hasattr(module, "connect"):
            monkeypatch.setattr(module, "connect", connect_through_hub)
