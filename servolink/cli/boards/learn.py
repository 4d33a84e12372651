"""`servolink doctor NAME --learn`: measure the undocumented behaviour of a board, and save a profile under its name."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from itertools import zip_longest
from textwrap import wrap
from typing import Any

from msgspec import Struct

from servolink.boards import BoardIdentityRecord, BoardProfile, Measured, ProfileFile, identity_of, resolve_url
from servolink.cli.command_session import Interruption, interruptible
from servolink.cli.screen.output import Table, is_terminal, print_error
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.screen.terminal import can_ask, confirm, wait_for_enter
from servolink.cli.usage import usage_error
from servolink.client import ALL, servo_id
from servolink.connection import options_in
from servolink.doctor import (
    AFTER_RESET,
    Contact,
    Learnt,
    SharedTransport,
    Trial,
    TrialLine,
    connected,
    interval_finding,
    learn_by_asking,
    learn_by_writing,
    make_contact,
    plan_movement,
)
from servolink.errors import ConnectionLost, OpenError, RequestTimeout, ServolinkError
from servolink.project import BackupStore
from servolink.protocol import Codec
from servolink.support import ExitCode, is_name
from servolink.transports import create

_NOTHING = "nothing was changed on the board"
_VALUE, _EVIDENCE = 13, 38  # columns on a terminal of 80
_REOPENING = 15.0  # seconds for a port to come back after the power was switched off and on


class LearntSetting(Struct, frozen=True):
    """Setting that was measured; null for an unknown value."""

    setting: str
    value: Any
    confidence: str | None
    evidence: str


class BoardLearnt(CommandResult, frozen=True):
    """JSON of `doctor` with --learn; `file` is the file of the profile."""

    name: str
    file: str
    findings: list[LearntSetting]
    profile: BoardProfile


@interruptible(_NOTHING)
async def run(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Learn the board and keep what was learnt."""
    name = args.board or args.url
    if not name or not is_name(name):
        usage_error(
            args,
            "--learn keeps what it measures under the board's name, so give it one first:\n"
            f"  servolink use NAME {name or 'BOARD'}\n  servolink doctor NAME --learn",
        )
    if args.servo == ALL:
        usage_error(args, "--servo times a single servo, not `all`")
    if args.clear and not args.write:
        usage_error(args, "--clear needs --write")
    if args.write and not args.yes and not can_ask():
        usage_error(args, "--write changes the board for a while; nobody can be asked here, so give --yes")
    kept = ProfileFile(name).load() or BoardProfile()  # a damaged profile ends the command before any measurement
    store = BackupStore() if args.write else None
    return await _Lesson(args, name, kept, store, interruption).run()


class _Lesson:
    """One run of the command."""

    def __init__(
        self,
        args: argparse.Namespace,
        name: str,
        profile: BoardProfile,
        store: BackupStore | None,
        interruption: Interruption,
    ) -> None:
        self._args = args
        self._name = name
        self._profile = profile
        self._store = store
        self._interruption = interruption

    async def run(self) -> Ending:
        await resolve_url(
            self._name, through_hub=False
        )  # nobody needs to switch a board off and on whose name is unknown
        power_cycled = self._args.power_cycled or await self._ask_for_power()
        with self._interruption.watched():
            transport, contact = await self._contact(may_wait=power_cycled)
            try:
                return await self._learn(transport, contact, power_cycled=power_cycled)
            finally:
                await transport.free()

    async def _contact(self, *, may_wait: bool) -> tuple[SharedTransport, Contact]:
        """Open the board and make contact; once more if the first opening resets the board."""
        for is_last in (False, True):
            transport: SharedTransport | None = None
            try:
                transport = await self._opened(may_wait=may_wait)
                self._show_step("looking for the board, in both byte orders and transmission modes")
                return transport, await make_contact(transport, self._args.timeout)
            except BaseException as error:
                if transport is not None:
                    await transport.free()
                if is_last or not isinstance(error.__cause__ or error, ConnectionLost):
                    raise
            await asyncio.sleep(AFTER_RESET)
        raise AssertionError  # the last round returns or raises

    async def _learn(self, transport: SharedTransport, contact: Contact, *, power_cycled: bool) -> Ending:
        args = self._args
        servo_id = await self._servo_id(transport, contact)  # first: without the servo, everything else is in vain
        learnt = await learn_by_asking(
            transport, contact, power_cycled=power_cycled, patience=args.timeout, on_step=self._show_step
        )
        identity = await _identity(transport.url, learnt)
        if not await self._may_keep(identity):
            return ExitCode.FAILED
        self._keep(learnt, identity)
        if self._store is not None and await self._may_write():
            await self._write(transport, learnt, self._store)
            self._keep(learnt, identity)
        if servo_id is not None:
            learnt.measured.append(await self._time_movement(transport, learnt, servo_id))
            self._keep(learnt, identity)
        return self._result(learnt)

    async def _servo_id(self, transport: SharedTransport, contact: Contact) -> int | None:
        """Return the id of the servo to move, None for none. Raise RequestTimeout if captions cannot be read."""
        if not isinstance(self._args.servo, str):
            return None if self._args.servo is None else int(self._args.servo)
        codec = Codec(contact.byte_order, self._caption_encoding(transport.url) or "utf-8")
        async with connected(transport, codec, self._args.timeout) as board:
            try:
                return await servo_id(board, self._args.servo)
            except RequestTimeout as error:
                raise RequestTimeout(f"{error}; without captions, --servo needs an id") from error

    async def _write(self, transport: SharedTransport, learnt: Learnt, store: BackupStore) -> None:
        try:
            await learn_by_writing(
                transport,
                learnt,
                store,
                caption_encoding=self._caption_encoding(transport.url),
                clear=self._args.clear,
                on_trial=self._note_trial,
                on_step=self._show_step,
            )
        except ServolinkError:
            print_error(f"servolink: {self._interruption.state}")
            raise

    def _caption_encoding(self, url: str) -> str | None:
        """Return the encoding in which commands will read captions, and so the backup; None if nothing says."""
        return options_in(url).get("caption_encoding") or self._profile.settings.caption_encoding

    async def _ask_for_power(self) -> bool:
        """Ask for the board to be switched off and on; return whether it was."""
        if not can_ask() or self._args.yes:
            return False
        return await wait_for_enter(
            f"switch {self._name} off and on, and press Enter when it has started (n to skip): "
        )

    async def _opened(self, *, may_wait: bool) -> SharedTransport:
        """Open the board; the port of a board just switched on may take a while to appear again."""
        loop = asyncio.get_running_loop()
        end = loop.time() + (_REOPENING if may_wait else 0.0)
        while True:
            try:
                transport = SharedTransport(create(await resolve_url(self._name, through_hub=False)))
                # A reset ends the connection, of which the caller hears with the first query.
                with suppress(ConnectionLost):
                    async with TrialLine(transport, Codec()):
                        pass
            except OpenError:
                if loop.time() >= end:
                    raise
            else:
                return transport
            await asyncio.sleep(0.2)

    async def _may_keep(self, identity: BoardIdentityRecord) -> bool:
        """Return whether the board is the board of the profile, or may replace the board of the profile."""
        kept = self._profile.identity
        if kept is None or kept.fits(identity):
            return True
        for line in (f"this is not the board that {self._name} was:", *_differences(kept, identity)):
            print_error(line)
        question = f"keep this board as {self._name}, and forget what was learnt of the other?"
        if self._args.yes or (can_ask() and await confirm(question)):
            self._profile = BoardProfile(limits=self._profile.limits)
            return True
        print_error(f"nothing was kept; --yes keeps it as {self._name}, `servolink use` gives it another name")
        return False

    async def _may_write(self) -> bool:
        if self._args.yes:
            return True
        if not await confirm("write to the board? what is on it is saved first, and restored"):
            return False
        if self._args.clear and not await confirm("also delete everything on it once, and restore it?"):
            self._args.clear = False
        return True

    def _note_trial(self, trial: Trial | None) -> None:
        if trial is None:
            self._interruption.state = "the content of the board is the same as before"
            return
        self._interruption.state = (
            "the board may hold records of this measurement; nothing is lost: "
            f"`servolink -b {self._name} rollback {int(trial.backup.name.split('-')[0])}` restores what was on it"
        )

    async def _time_movement(self, transport: SharedTransport, learnt: Learnt, servo_id: int) -> Measured:
        async with connected(transport, learnt.codec(), self._args.timeout) as board:
            planned = await plan_movement(board, servo_id, self._profile.limits)
            print_error(str(planned))
            self._interruption.state = f"servo {planned.servo_id} was moved, and a stop was sent to all servos"
            measured = await interval_finding(board, planned)
            self._interruption.state = f"servo {planned.servo_id} is back where it was"
        return measured

    def _keep(self, learnt: Learnt, identity: BoardIdentityRecord) -> None:
        self._profile = self._profile.merged(learnt.measured, identity, datetime.now(UTC).replace(microsecond=0))
        self._path = ProfileFile(self._name).save(self._profile)

    def _show_step(self, step: str) -> None:
        if is_terminal():
            print_error(f"{step} ...")

    def _result(self, learnt: Learnt) -> Returned:
        findings = [LearntSetting(one.setting, one.value, _confidence(one), one.evidence) for one in learnt.measured]
        rows = [(one.setting, _value(one.value), one.confidence or "", one.evidence) for one in findings]
        table = Table(("setting", "value", "confidence", "evidence"), list(_fitted(rows)))
        return Returned(
            BoardLearnt(self._name, str(self._path), findings, self._profile), [table, f"kept in {self._path}"]
        )


async def _identity(url: str, learnt: Learnt) -> BoardIdentityRecord:
    port = await asyncio.to_thread(identity_of, url)
    servo_ids = learnt.survey.servo_ids
    return BoardIdentityRecord.of(
        servo_ids=None if servo_ids is None else tuple(sorted(servo_ids)),
        memory_total=learnt.survey.memory_total,
        vendor_id=port.vendor_id if port else None,
        product_id=port.product_id if port else None,
        serial_number=(port.serial_number or None) if port else None,
    )


def _differences(kept: BoardIdentityRecord, found: BoardIdentityRecord) -> list[str]:
    """Return a row for each difference between two identities of a board."""
    return [
        f"  {name.replace('_', ' ')}: {_value(getattr(kept, name))} was kept, {_value(getattr(found, name))} is here"
        for name in kept.__struct_fields__
        if getattr(kept, name) != getattr(found, name)
    ]


def _value(value: object) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, float):  # always a time
        return f"{value:.3g} s" if value >= 1 else f"{value * 1000:.3g} ms"
    return str(value)


def _confidence(measured: Measured) -> str | None:
    return None if measured.value is None else measured.confidence


def _fitted(rows: Iterable[tuple[str, str, str, str]]) -> Iterator[tuple[str, str, str, str]]:
    """Yield `rows` with long cells wrapped to fit a terminal of 80 columns; unchanged elsewhere."""
    for setting, value, confidence, evidence in rows:
        if not is_terminal():
            yield setting, value, confidence, evidence
            continue
        values, texts = wrap(value, _VALUE), wrap(evidence, _EVIDENCE)
        for number, (line, text) in enumerate(zip_longest(values, texts, fillvalue="")):
            yield (setting, line, confidence, text) if number == 0 else ("", line, "", text)
