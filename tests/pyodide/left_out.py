"""Tests that Pyodide cannot run, with the reason, and what holds the table to it.

The tests that `run_tests.py` is given are run without those of the table; a row of theirs without a test is an error.
With `--left-out` only those of the table are run: a test that passes is an error, and so is a file that can be imported
if a row says that it cannot.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

UNIMPORTABLE: dict[str, tuple[str, ...]] = {
    "a driver of devices is imported, which needs the operating system": (
        "client/test_profiles.py",
        "hub/test_doors_greeting.py",
    ),
    "limits of processes are imported, of which Pyodide has none": ("hub/test_survival.py",),
}
"""Files whose import fails, by reason."""

FAILING: dict[str, tuple[str, ...]] = {
    "there are no sockets, so a line of bytes cannot be one": (
        "connection/test_deadlines.py::test_a_line_that_never_falls_silent_does_not_put_a_deadline_off_for_ever",
        "connection/test_deadlines.py::test_after_a_stall_all_that_has_arrived_is_read_first",
        "connection/test_watchdog.py::test_a_flood_of_events_puts_no_deadline_off",
        "connection/test_watchdog.py::test_a_response_that_arrived_in_time_is_no_timeout_however_long_the_loop_was_busy",
        "connection/test_watchdog.py::test_a_response_that_comes_after_its_deadline_is_late_though_the_loop_was_busy",
        (
            "connection/test_watchdog.py::"
            "test_a_response_to_a_fence_that_arrived_in_time_counts_however_long_the_loop_was_busy"
        ),
    ),
    "there are no sockets, so nothing is served or reached at an address of TCP or of a hub": (
        "client/test_closing.py::test_a_board_whose_loop_ended_while_it_was_lost_can_be_closed",
        "client/test_closing.py::test_closing_after_the_loop_has_ended_frees_a_tcp_connection",
        "client/test_shared_board.py",
        "control/test_share_address.py::test_a_hub_that_says_nothing_is_given_up",
        "hub/test_control_hostile.py::test_a_line_without_end_is_cut_off",
        "hub/test_control_hostile.py::test_garbage_gets_one_error_a_line",
        "hub/test_control_hostile.py::test_who_asks_and_does_not_read_is_disconnected",
        "hub/test_control_hostile.py::test_who_watches_and_does_not_read_costs_little",
        "hub/test_control_stream.py::test_a_board_on_share_streams_through_the_hub_within_its_own_limits_too",
        "hub/test_cut_captions.py::test_the_control_interface_passes_each_byte_on",
        "hub/test_doors_socket.py",
        "hub/test_late_word.py::test_after_catching_up_a_program_has_heard_of_the_stop_and_the_lease_of_another_one",
        "hub/test_lost_board.py::test_a_program_with_a_board_of_its_own_sends_nothing_to_a_lost_board",
        "virtual/test_serving.py::test_a_host_that_asks_a_lot_at_once_and_reads_slowly_gets_it_all",
        "virtual/test_serving.py::test_a_host_that_stops_sending_still_gets_its_answers",
        "virtual/test_serving.py::test_an_unplugged_host_can_connect_again",
        "virtual/test_serving.py::test_each_connection_draws_its_own_faults",
        "virtual/test_serving.py::test_the_end_closes_every_conversation",
        "virtual/test_serving.py::test_two_hosts_at_once_have_their_own_conversations",
    ),
    "there are no pseudo-terminals": (
        "hub/test_doors_pty.py",
        "virtual/test_serving.py::test_a_pseudo_terminal_is_raw_for_hosts_that_set_nothing",
        "virtual/test_serving.py::test_a_pseudo_terminal_outlives_its_hosts",
        "virtual/test_serving.py::test_an_unplugged_pseudo_terminal_hangs_up",
        "virtual/test_serving.py::test_both_are_served_at_once_and_the_urls_come_in_order",
        "virtual/test_work.py::test_over_a_pseudo_terminal_it_works_as_well",
    ),
    "there are no threads": (
        "client/test_button_events.py::test_an_iterator_that_python_collects_in_another_thread_unsubscribes",
        "client/test_closing.py::test_a_board_of_a_loop_that_runs_is_not_closed_in_another",
        "client/test_motion_check.py::test_the_sync_board_refuses_and_allows_the_same",
        "connection/test_connection_loop.py::test_in_another_loop_it_says_so_at_once",
        "hub/test_hub_recorder.py",
        "project/test_summary.py::test_a_board_is_a_table_too",
    ),
    "there are no processes": (
        "hub/test_hub_processes.py",
        "hub/test_stopped_group.py",
        "project/test_killed.py::test_a_host_that_is_killed_at_any_file_step_loses_nothing",
    ),
    "there are no pipes, and devices are regular files": (
        "project/test_file.py::test_a_file_without_end_is_not_read_to_its_end",
        "project/test_file.py::test_a_pipe_is_not_read",
    ),
    "a package is needed that Pyodide is not given here: pyserial, tomlkit, or servolink as an installed one": (
        "client/test_board_methods.py::test_the_package_lists_its_public_names_and_tells_its_version",
        "client/test_board_methods.py::test_the_traceback_of_a_missing_port_is_short[/dev/no-such-port]",
        "client/test_profile_guard.py::test_another_board_served_in_the_place_of_rex_is_refused",
        "client/test_profile_guard.py::test_another_board_that_comes_back_under_the_name_is_refused",
    ),
}
"""Files, tests and single examples that fail, by reason; each test of a file does."""


UNRUN: dict[str, tuple[str, ...]] = {
    "macros are nested 5,000 deep, and to free 1,000 overflows the stack of JavaScript, which ends Pyodide": (
        "project/test_build.py::test_deep_macros_are_built_or_refused",
    ),
    "there are no sockets, and a connection to one is waited for": ("hub/test_doors_tcp.py", "hub/test_web_page.py"),
}
"""Tests that end Pyodide or wait for ever, by reason; nothing runs them there."""


RUNNING = (
    "tests/client/test_shared_board.py::test_an_error_of_the_hub_is_one_of_the_library",
    "tests/hub/test_doors_socket.py::test_a_long_folder_is_no_obstacle",
)
"""Tests that run although the table has their file."""


def rows(table: dict[str, tuple[str, ...]]) -> dict[str, str]:
    """Return the reason of each row, which is the start of the ids of tests."""
    return {f"tests/{row}": reason for reason, those in table.items() for row in those}


def is_of(row: str, test: str) -> bool:
    """Return whether the id of a test is that of a row, or below it."""
    return (test == row or test.startswith((f"{row}::", f"{row}["))) and not test.startswith(RUNNING)


class Without:
    """Plug-in of pytest that leaves out the tests of the table."""

    def __init__(self, chosen: Iterable[str]) -> None:
        self._chosen = tuple(chosen)

    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        """Do not import what cannot be imported."""
        return str(collection_path.relative_to(ROOT)) in rows(UNIMPORTABLE) or None

    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Take the tests of the table away; raise UsageError for a row without a test."""
        failing = {row for row in rows(FAILING | UNRUN) if row.startswith(self._chosen)}
        out = {item: row for item in items for row in failing if is_of(row, item.nodeid)}
        if missing := failing - set(out.values()):
            raise pytest.UsageError(f"rows without a test: {sorted(missing)}")
        items[:] = [item for item in items if item not in out]
        config.hook.pytest_deselected(items=list(out))


class Only:
    """Plug-in of pytest that has each import and each test of the table fail."""

    def pytest_sessionstart(self) -> None:
        """Raise UsageError for a file that can be imported."""
        for row in rows(UNIMPORTABLE):
            module = row.removesuffix(".py").replace("/", ".")
            try:
                import_module(module)
            except ImportError as error:
                if error.name != module:  # which is missing itself otherwise
                    continue
            raise pytest.UsageError(f"{row} can be imported, or is not there")

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Expect each to fail, for the reason in the table."""
        items[:] = [item for item in items if not item.nodeid.startswith(RUNNING)]
        for item in items:
            [reason] = [reason for row, reason in rows(FAILING).items() if is_of(row, item.nodeid)]
            item.add_marker(pytest.mark.xfail(reason=reason, strict=True))
