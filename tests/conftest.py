"""What all tests share: how hypothesis searches, folders in place of the user's own, and how programs end."""

from __future__ import annotations

import gc
import inspect
import logging
import os
import signal
import sys
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module

import pytest
from hypothesis import HealthCheck, settings

from tests.processes import sessions
from tests.virtual_time import run

# No deadline: these machines stall. On a build server the same examples are tried each time, so that a change
# fails because of what it changed; everywhere else new ones are.
settings.register_profile("here", deadline=None, max_examples=20)
settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True, print_blob=True)
settings.register_profile(
    "emscripten", settings.get_profile("ci"), max_examples=5, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("emscripten" if sys.platform == "emscripten" else "ci" if os.environ.get("CI") else "here")


_BY_NUMBERS = ("tests/proofs/reliability/", "tests/proofs/hostile/test_lying_boards.py")
"""Tests that prove something by its numbers, through lines that others cover too."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the choice of the board behind the addresses of virtual boards."""
    parser.addoption("--board", choices=("virtual", "firmware"), default="virtual", help="board of the tests")


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Run the tests in three processes on two cores: a quarter of the time, they wait for programs and lines."""
    cores = yield
    return cores + cores // 2


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine function in virtual time."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    wanted = inspect.signature(pyfuncitem.obj).parameters
    run(pyfuncitem.obj(**{name: value for name, value in pyfuncitem.funcargs.items() if name in wanted}))
    return True


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Have each process import another part of the tests first, so that no two compile the same modules."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    root = session.config.rootpath
    places = [session.config.invocation_params.dir / each.partition("::")[0] for each in session.config.args]
    files = sorted(path for place in places for path in place.rglob("test_*.py") if root in path.parents)
    for path in files[int(worker["workerid"].removeprefix("gw")) :: worker["workercount"]]:
        with suppress(Exception, pytest.skip.Exception):  # collecting says what is wrong with it
            import_module(".".join(path.relative_to(root).with_suffix("").parts))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Measure no coverage while numbers are the proof: they take three times as long then."""
    for item in items:
        if item.nodeid.startswith(_BY_NUMBERS):
            item.add_marker("no_cover")


def pytest_configure(config: pytest.Config) -> None:
    """Collect no garbage while tests are collected: there is none, and looking for it takes a third of the time."""
    gc.disable()
    if config.getoption("--board") == "firmware":
        config.pluginmanager.import_plugin("tests.firmware.board_option")


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Keep the garbage collector from going through ten thousand tests again and again, which never are garbage."""
    if sys.platform != "emscripten":  # where hypothesis misses its random numbers among what is frozen
        gc.freeze()
    gc.set_threshold(100_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _folders_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let no test see the boards, names and backups of whoever runs it, nor leave any."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
            patch.setenv(name, str(tmp_path_factory.mktemp(name)))
        yield


@pytest.fixture(scope="session", autouse=True)
def _signals_end_programs() -> Iterator[None]:
    """Replace signals that are ignored, in which case the programs that tests interrupt would ignore them too.

    They are where pytest runs in the background of a script, or under `nohup`.
    """
    ignored = [
        number
        for number in (() if sys.platform == "win32" else (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
        if signal.getsignal(number) is signal.SIG_IGN
    ]
    for number in ignored:
        # A handler of ours is not inherited. SIGINT gets the usual one, beside which asyncio sets its own.
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else lambda *_: None)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def _files_are_not_synced() -> Iterator[None]:
    """Leave files to the system, as nothing here has to outlive a power failure; a disk takes its time for each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_program_outlives_the_tests() -> Iterator[None]:
    yield
    sessions.close()


@pytest.fixture
def caplog(caplog: pytest.LogCaptureFixture) -> Iterator[pytest.LogCaptureFixture]:
    """Keep what this package logs, and nothing else: asyncio may log at any time what another test left to it."""
    ours = logging.Filter("servolink")
    caplog.handler.addFilter(ours)
    yield caplog
    caplog.handler.removeFilter(ours)


class _Warnings(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


@contextmanager
def _listening() -> Iterator[Callable[[], list[str]]]:
    """Yield a function for the warnings and errors that this package and asyncio have logged in this context.

    asyncio logs an error that nobody waited for when its task is collected. So earlier garbage is collected first, and
    that of this context before the function returns.
    """
    handler = _Warnings()

    def logged() -> list[str]:
        gc.collect()
        return handler.messages

    gc.collect()
    loggers = [logging.getLogger(name) for name in ("servolink", "asyncio")]
    for logger in loggers:
        logger.addHandler(handler)
    yield logged
    for logger in loggers:
        logger.removeHandler(handler)


@pytest.fixture
def warnings_logged() -> Iterator[Callable[[], list[str]]]:
    """Return a function for the warnings and errors that this test made this package and asyncio log."""
    with _listening() as logged:
        yield logged


@pytest.fixture(scope="module")
def nothing_logged() -> Iterator[None]:
    """Fail at the end of a module if this package or asyncio has logged a warning. Garbage is collected once."""
    with _listening() as logged:
        yield
        assert logged() == []


@pytest.fixture(autouse=True)
def _no_program_outlives_its_test() -> Iterator[None]:
    with sessions.ending():
        yield
