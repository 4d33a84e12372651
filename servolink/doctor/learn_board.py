"""Measurement of all board properties left open by the document, in the least disturbing order."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from servolink.boards import Measured
from servolink.doctor.all_responses import FORGETS, after_pause
from servolink.doctor.learn_captions import encoding_finding, listed_captions
from servolink.doctor.learn_line import Quality, SharedTransport, TrialLine, measure_quality
from servolink.doctor.learn_queries import (
    Contact,
    Survey,
    byte_order_finding,
    depth_finding,
    longer_findings,
    mode_findings,
    survey_board,
    turnaround_finding,
    twice_findings,
    unknown_ids_finding,
    unsupported_finding,
)
from servolink.doctor.learn_trial import Trial, begin_trial, end_trial
from servolink.doctor.learn_writes import (
    clear_findings,
    duplicate_finding,
    memory_finding,
    project_id_finding,
    write_depth_finding,
)
from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.project import BackupStore
from servolink.protocol import Codec
from servolink.transports import Address

Step = Callable[[str], None]
"""Function called with the next step, such as "sending many queries at once"."""


def ignore_step(step: str) -> None:
    """Ignore the step."""


@dataclass(slots=True)
class Learnt:
    """Measured properties of a board."""

    contact: Contact
    quality: Quality
    survey: Survey
    measured: list[Measured] = field(default_factory=list)

    def value(self, setting: str) -> object:
        """Return the measured value of a setting, None without a measurement."""
        return next((each.value for each in self.measured if each.setting == setting), None)

    def codec(self, caption_encoding: str | None = None) -> Codec:
        """Return the codec of the board; `caption_encoding` is the encoding for later programs."""
        return Codec(self.contact.byte_order, str(caption_encoding or self.value("caption_encoding") or "utf-8"))


_FORGETS = (
    Measured(
        "transmission_mode",
        value=1,
        confidence="likely",
        evidence="after a pause, the board answered only when mode 1 was set again",
    ),
)


async def learn_by_asking(
    transport: SharedTransport,
    contact: Contact,
    *,
    power_cycled: bool = False,
    patience: float | None = None,
    on_step: Step = ignore_step,
) -> Learnt:
    """Measure with queries only, after `make_contact`; the board is not changed.

    `power_cycled`: the board was just switched off and on. `patience` is the time to wait for each response, until the
    response times are known.
    """
    async with TrialLine(transport, Codec(contact.byte_order)) as line:
        line.patience = patience or max(line.patience, 2 * contact.slowest)
        pause = await after_pause(transport, line, contact.answered[0])
        if pause is not None and pause.check != FORGETS:
            raise OpenError(f"{transport.url}: {pause.observation}: {pause.meaning}; learn after that")
        on_step("sending single queries")
        quality = await measure_quality(line, contact.answered)
        on_step("sending each kind of query")
        survey = await survey_board(line, quality, transport.record)
        learnt = Learnt(contact, quality, survey)
        learnt.measured += [
            byte_order_finding(contact, quality),
            *longer_findings(contact),
            *twice_findings(contact),
            *(_FORGETS if pause else mode_findings(contact, quality, power_cycled=power_cycled)),
            encoding_finding(listed_captions(survey)),
            unsupported_finding(survey, quality),
        ]
        on_step("querying ids that the board does not list")
        learnt.measured.append(await unknown_ids_finding(line, survey, quality, transport.record))
        learnt.measured.append(turnaround_finding(contact.answered[0], survey, quality, _baudrate(transport.url)))
        on_step("sending many queries at once")
        learnt.measured.append(await depth_finding(line, survey, quality))
    return learnt


def _baudrate(url: str) -> int | None:
    address = Address.parse(url)
    return address.integer("baudrate", 115200, 50, 12_000_000) if address.scheme == "serial" else None


async def learn_by_writing(
    transport: SharedTransport,
    learnt: Learnt,
    store: BackupStore,
    *,
    caption_encoding: str | None = None,
    clear: bool = False,
    on_trial: Callable[[Trial | None], None] = lambda trial: None,
    on_step: Step = ignore_step,
) -> None:
    """Add measurements by writing to `learnt`; the content of the board is saved first and restored at the end.

    The backup is for programs with `caption_encoding`, by default the measured encoding. `clear` also deletes all
    content of the board once. `on_trial` is called before the first write, and with None after the restoration. After
    an interruption in between, the board has an unfinished import, to be undone by `rollback_project`. Raise
    ProjectError for a board with an unfinished import.
    """
    on_step("saving the content of the board")
    trial = await begin_trial(transport, learnt.codec(caption_encoding), store, on_trial)
    try:
        learnt.measured += await _write(trial, learnt, on_step, clear=clear)
    except ConnectionLost:
        raise
    except ServolinkError:
        with suppress(ServolinkError):  # an error of the restoration says less than the first error
            await end_trial(trial)
            on_trial(None)
        raise
    on_step("restoring the content of the board")
    await end_trial(trial)
    on_trial(None)


async def _write(trial: Trial, learnt: Learnt, on_step: Step, *, clear: bool) -> list[Measured]:
    measured = []
    async with trial.board() as board:
        on_step("writing a project id")
        measured.append(await project_id_finding(board, trial))
        on_step("storing records, and reading how much memory is free")
        measured.append(await memory_finding(board, trial))
        on_step("storing records twice")
        measured.append(await duplicate_finding(board, trial))
    on_step("storing many records at once")
    measured.append(await write_depth_finding(trial, learnt.quality, learnt.contact.answered))
    if clear:
        on_step("clearing the board")
        async with trial.board() as board:
            measured += await clear_findings(board, trial)
    return measured
