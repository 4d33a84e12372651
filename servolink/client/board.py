"""Board: every command of the protocol as a method, by chapters of the document."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Iterable, Mapping
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar, cast

from servolink.client.board_servos import Servo, ServoController
from servolink.client.captions import Targets
from servolink.client.session import Session
from servolink.connection.connection import Connection
from servolink.connection.stats import Stats
from servolink.control.status import ConnectionState
from servolink.escaping import escape, html_table
from servolink.motion.angles import AngleUnit
from servolink.motion.limits import MotionLimits
from servolink.motion.movement import INTERVAL_UNIT, Speed
from servolink.motion.ticket import Ticket
from servolink.motion.units import ServoUnits
from servolink.numeric import as_number
from servolink.project.transfer.results import ApplyResult, Plan, ProgressCallback, ignore_progress
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Command, Packet, Request, Response
from servolink.protocol.record_types import ACTION, MACRO, TABLE
from servolink.protocol.records import (
    Action,
    ActionEntry,
    JoystickTable,
    JoystickTableEntry,
    Macro,
    MacroEntry,
    ServoParameter,
)
from servolink.protocol.servos import ALL_SERVOS
from servolink.protocol.settings import (
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    SendDummyDataRequest,
)

if TYPE_CHECKING:  # imported at first use: few programs use most of these modules
    from pathlib import Path

    from servolink.client.alarms import Alarm
    from servolink.client.board_records import RecordStore
    from servolink.client.button_events import ButtonEvents, ButtonSubscription
    from servolink.client.playing import Playback, Playing
    from servolink.client.projects import ProjectTransfers
    from servolink.client.raw_packets import RawPackets
    from servolink.client.servo_readings import ServoReadings, ServoWatch
    from servolink.client.servo_stream import ServoStream
    from servolink.client.stored_runs import StoredRuns
    from servolink.motion.set_points import SetPoints
    from servolink.profiles.profile import ProfileInUse
    from servolink.project.model import Project

R = TypeVar("R", bound=Response)


class Board:
    """A connected board, made by `connect`, with a method for each command of the protocol's document, by chapters.

    - Connection: `url`, `codec`, `profile`, `limits`, `connection`, `stats`, `states`, `request`, `send`,
      `took_effect`, `close`
    - 3.1 settings: `set_transmission_mode`, `clear_all_data`, `memory`, `battery`, `send_dummy_data`
    - 3.2 servos: `servo_ids`, `servos`, `watch`, `servo`, `set_servo`, `release`, `stop`, `set_angle_unit`, `unit_of`,
      `units`, `move`, `stream`, `follow`, `run_action`, `play`
    - 3.3 stored records: `actions`, `action`, `add_action`, `delete_action`, `macros`, `macro`, `add_macro`,
      `delete_macro`, `run_macro`, `servo_parameters`, `add_servo_parameters`, `write_project_id`, `project_id`
    - 3.4 joystick: `joystick_tables`, `joystick_table`, `add_joystick_table`, `delete_joystick_table`,
      `set_active_joystick_table`, `active_joystick_table`, `button_events`
    - 4 projects: `export_project`, `plan_project`, `apply_project`, `rollback_project`, `has_unfinished_import`

    Numbers in parentheses are sections of the document. Servo ids are 0..254, and 255 (`ALL_SERVOS`) stands for all;
    other ids are 32-bit integers. A method that asks the board raises RequestTimeout if it does not answer,
    OutcomeUnknown if a command was sent and not answered, ConnectionLost if the connection is lost, and EncodeError,
    before anything is sent, for a value that does not fit the protocol.

    In place of an id, methods take a caption, such as `"hip"`, and for all servos `"all"`. A text of digits is an id,
    `"name:3"` the caption `3`. A caption that is written exactly so comes first, then one that differs in case only.
    Captions are read from the board each time; for an integer nothing more is sent. An unknown caption raises NotFound,
    one that several things have AmbiguousName.

    Limits (`angle_limits`, `speed_cap` and `soft_start`, of `connect` or of the board's profile) hold for everything
    that moves servos. What a run uses is read first, and each step is checked from where those before it end, the first
    from where the servos are. A step beyond a limit raises MotionRefused, with nothing moved. With `soft_start`, servos
    whose first movement this would be (see `move`) then go to their first angles in the run, no faster than that. When
    they have arrived, everything is checked again, and the run begins. A stop in between raises RequestRefused, a servo
    that does not arrive TargetNotReached. With `dry_run`, everything is checked and nothing moves.
    """

    def __init__(
        self,
        session: Session,
        angle_unit: AngleUnit | None,
        limits: MotionLimits,
        interval_unit: float = INTERVAL_UNIT,
    ) -> None:
        """Use `connect` instead."""
        self._session = session
        self._limits = limits
        self._servos = ServoController(session, angle_unit, limits, interval_unit)
        self._interval_unit = interval_unit
        self._ticket: Ticket | None = None  # ticket for all motions; None for a new ticket in each call

    @cached_property
    def _packets(self) -> RawPackets:
        from servolink.client.raw_packets import RawPackets

        return RawPackets(self._session, self._servos, lambda: self._runs, self._limits)

    @cached_property
    def _records(self) -> RecordStore:
        from servolink.client.board_records import RecordStore

        return RecordStore(self._session)

    @cached_property
    def _buttons(self) -> ButtonSubscription:
        from servolink.client.button_events import ButtonSubscription

        return ButtonSubscription(self._session)

    @cached_property
    def _watch(self) -> ServoWatch:
        from servolink.client.servo_readings import ServoWatch

        return ServoWatch(self._session, self._servos)

    @cached_property
    def _projects(self) -> ProjectTransfers:
        from servolink.client.projects import ProjectTransfers

        return ProjectTransfers(self._session)

    @cached_property
    def _runs(self) -> StoredRuns:
        from servolink.client.stored_runs import StoredRuns

        return StoredRuns(self._session, self._servos, self._records, self._limits, self._interval_unit)

    @cached_property
    def _playing(self) -> Playing:
        from servolink.client.playing import Playing

        return Playing(self._session, self._servos, self._runs, self._interval_unit)

    def __repr__(self) -> str:
        """Return name, address and state, such as `<Board "rex" virtual:// connected>`."""
        name = f'"{self.profile.name}" ' if self.profile is not None and self.profile.name else ""
        return escape(f"<Board {name}{self.url} {self._session.state}>")

    def _repr_html_(self) -> str:
        """Return a table, which notebooks show."""
        name = self.profile.name if self.profile is not None else None
        return html_table(("board", "address", "state"), [(name or "", self.url, self._session.state)])

    # --- the connection -----------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """The address of the board."""
        return self._session.url

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the connection."""
        return self._session.codec

    @property
    def profile(self) -> ProfileInUse | None:
        """Name and profile of the board; None if nothing is known of it (see `connect`)."""
        return self._session.profile

    @property
    def limits(self) -> MotionLimits:
        """The limits of movements: those given to `connect`, tightened by the profile's. False if there are none."""
        return self._limits

    @property
    def connection(self) -> Connection:
        """An object that stands for the present connection: another one after a reconnect."""
        return cast("Connection", self._session.connection)  # another kind only within a hub

    @property
    def stats(self) -> Stats:
        """Counters of the connection: frames, bytes, noise, late responses, round trips."""
        return self._session.stats

    def states(self) -> AsyncGenerator[ConnectionState, None]:
        """Yield the present state (`connected`, `lost` or `closed`), then each change up to `closed`.

        A board that a hub shares is lost while the hub has lost it.
        """
        return self._session.states()

    async def request(self, packet: Request[R], *, timeout: float | None = None, unchecked: bool = False) -> R:
        """Send any packet that the board answers, and return the response, whatever it says.

        `timeout` (0.001..3600 seconds) limits the whole call, waiting for other requests included; None leaves it to
        the `patience` of the connection. `unchecked` allows values that only a board sends, such as control characters
        in captions, to give back what was read from it. With limits, an ExecuteMacroRequest is treated as by
        `run_macro`; `timeout` then counts from when it is sent.
        """
        return await self._packets.request(packet, timeout=as_number(timeout), unchecked=unchecked, ticket=self._ticket)

    async def send(self, packet: Command) -> None:
        """Send any packet that the board does not answer. Raise EncodeError if a movement has a servo twice.

        With limits, an ExecuteActionRequest beyond one is refused with MotionRefused, not changed; its angles are in
        the unit that is set for each servo. An ExecuteActionExRequest is treated as by `run_action`.
        """
        await self._packets.send(packet, ticket=self._ticket)

    async def took_effect(self, request: Packet) -> bool | None:
        """Return whether the board is now as `request` would have made it, to follow up on OutcomeUnknown.

        Return None for requests that leave no readable trace: motion, angle units, the transmission mode and the
        event subscription.
        """
        return await self._records.took_effect(request)

    async def close(self) -> None:
        """Unsubscribe from button events, close the connection and free the port; may be called again.

        Raise RuntimeError in another event loop than the one that connected, unless that has ended.
        """
        at_home = self._session.is_at_home()
        try:
            if at_home:  # otherwise the tasks that would be awaited here have ended with their loop
                await self._session.stop_reconnecting()
                used = vars(self)
                if "_watch" in used:
                    await self._watch.close()
                if "_buttons" in used:
                    await self._buttons.close()
        finally:
            await self._session.close()

    # --- 3.1 settings -------------------------------------------------------------------------------------------

    async def set_transmission_mode(self, mode: int) -> None:
        """Set mode 1, this protocol, or 0, an older one that servolink does not support (3.1.1).

        Raise Rejected if the board reports another mode.
        """
        await self._session.set_transmission_mode(as_number(mode))

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2). Raise Rejected if the board refuses.

        No other request is sent until the board has answered.
        """
        await self._session.clear_all_data()

    async def memory(self) -> QueryMemorySizeResponse:
        """Return the memory in bytes: `size` is free, `total_size` is None if the board does not report it (3.1.3).

        If the profile of the board knows the unit in which it counts, its numbers are converted.
        """
        found = await self._session.request(QueryMemorySizeRequest())
        unit = (self.profile and self.profile.settings.memory_unit) or 1
        total = None if found.total_size is None else found.total_size * unit
        return QueryMemorySizeResponse(found.size * unit, total)

    async def battery(self) -> float:
        """Return the remaining charge in percent, to 0.1 (3.1.4)."""
        return (await self._session.request(QueryRemainPowerRequest())).permil / 10

    async def send_dummy_data(self, data: bytes) -> None:
        """Send up to 65,535 bytes, which the board ignores (3.1.5)."""
        await self._session.send(SendDummyDataRequest(data))

    # --- 3.2 servos ---------------------------------------------------------------------------------------------

    async def servo_ids(self) -> tuple[int, ...]:
        """Return the ids of all servos (3.2.1)."""
        return await self._servos.servo_ids()

    async def servos(self) -> tuple[Servo, ...]:
        """Return the state of all servos (3.2.2)."""
        return await self._servos.servos()

    def watch(self, hz: float | None = None, *, alarms: Iterable[Alarm] = ()) -> ServoReadings:
        """Return an iterator over readings of all servos (3.2.2), `hz` times a second (0 < hz <= 1000).

        Without `hz`, as often as the line allows; a `depth` above 1 (see `connect`) makes that more. All iterators of
        a board share what is read. A reading has `seconds`, `servos`, `missed` and `alarms` (see `ServoReading`): which
        of the given alarms were raised. An alarm with `stops` stops all servos at once.
        """
        from servolink.client.alarms import checked_alarms
        from servolink.client.servo_readings import ServoReadings

        return ServoReadings(self._watch, as_number(hz), checked_alarms(alarms))

    async def servo(self, servo_id: int | str) -> Servo:
        """Return the state of one servo (3.2.2). Raise NotFound if the board has no such servo."""
        return await self._servos.servo(servo_id)

    async def set_servo(self, servo_id: int | str, *, start: bool, hold: bool) -> None:
        """Start a servo or stop it, hold its angle or release it (3.2.3).

        A stopped servo ignores movements; a released one is limp. Raise Rejected if the board reports another state.
        """
        await self._servos.set_servo(servo_id, start=start, hold=hold, ticket=self._ticket)

    async def release(self, servo_id: int | str = ALL_SERVOS) -> None:
        """Stop and release a servo, or all (3.2.3). It goes limp, and a raised limb falls."""
        await self._servos.set_servo(servo_id, start=False, hold=False, ticket=self._ticket)

    async def stop(self) -> None:
        """Stop all servos where they are and hold them, ahead of every other request (3.2.3).

        Confirmed by reading the servos. Raise OutcomeUnknown if they do not all report that they are stopped and held.
        A stopped servo ignores movements until `set_servo(..., start=True, hold=True)`.
        """
        await self._servos.stop()

    async def set_angle_unit(self, unit: AngleUnit, servo_id: int | str = ALL_SERVOS) -> None:
        """Set the unit of a servo's angles, `degree` or `adc` (3.2.4). Raise Rejected if the board refuses."""
        await self._servos.units.set(unit, servo_id)

    def unit_of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo's angles, None if it is unknown. Does not ask the board: takes no caption."""
        return self._servos.units.of(servo_id)

    @property
    def units(self) -> ServoUnits:
        """The units that are known to be set on the board. Change them with `set_angle_unit` only."""
        return self._servos.units.current

    async def move(
        self,
        targets: Targets,
        *,
        duration: float | None = None,
        speed: Speed | None = None,
        wait: bool = False,
        dry_run: bool = False,
    ) -> float:
        """Move servos together to angles in degrees (or `Adc`) and return the duration in seconds (3.2.5).

        Give either `duration`, 0.01..327.67 seconds, or `speed` in degrees per second, one for all servos or a mapping
        by servo id: then the present angles are read first, and each servo turns at its speed. Raise MotionRefused,
        before anything moves, for an angle outside `angle_limits` or a speed above `speed_cap`. Without `angle_limits`
        any angle is sent, as the protocol gives no range.

        With `soft_start`, the first movement of a servo is no faster than that: if need be, the whole movement takes
        longer, for all of its servos alike, and so does the returned duration. The first movement is that on a new
        connection, or after the servo was stopped or released; it lasts until its planned end, whatever is sent until
        then.

        Returns when the movement was sent, which says nothing about the servos: the board reports no errors, and a
        servo turns only as far as it can. With `wait`, returns when all have arrived, and raises TargetNotReached for
        one that is not within 2 degrees of its target a second after the planned end.
        """
        return await self._servos.move(
            targets, duration=duration, speed=speed, wait=wait, dry_run=dry_run, ticket=self._ticket
        )

    def stream(self, hz: float = 50.0, *, gap: float = 0.5) -> ServoStream:
        """Return a stream of set-points (3.2.5), at most `hz` a second (0 < hz <= 100), as from a gamepad or a policy.

        `await stream.send({1: 30.5})` turns servos toward angles in degrees and returns the angles sent. Limits refuse
        nothing there: an angle is replaced by the nearest whole one within `angle_limits`, and a way too long for
        `speed_cap` or `soft_start` is shortened. The way begins where the last target has brought the servo by now, or
        at a reading if nothing was sent for 0.5 s or something else has moved.

        A set-point that is not sent yet is dropped when a newer one comes. The stream ends with a stop, with a loss of
        the connection, and when no set-point is given for `gap` seconds, at most 10; servos keep their last targets.
        """
        from servolink.client.servo_stream import stream_on

        return stream_on(self._session, self._servos, self._limits, hz, gap, self._interval_unit, self._ticket)

    def follow(
        self, targets: Targets, seconds: float, *, settle: bool = False
    ) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Read all servos every 40 ms (3.2.2): for `seconds`, and until those in `targets` have arrived there.

        For a movement that takes `seconds`, as returned by `move`. With `settle`, reading goes on until two readings
        are equal. Raise TargetNotReached for a servo that has not arrived a second after the planned end, and
        OutcomeUnknown if the board does not answer meanwhile.
        """
        return self._servos.follow(targets, as_number(seconds), settle=settle)

    async def run_action(self, action_id: int | str, *, wait: bool = False, dry_run: bool = False) -> float:
        """Run a stored action (3.2.6) and return its duration in seconds. Raise NotFound if there is none.

        Returns when the command is sent: the board does not answer it. With `wait`, returns when the duration is over
        and the servos rest at their last angles. Raise TargetNotReached that names the servos that are not within 2
        degrees of them a second later, and RequestRefused if `stop` ends the run. A cancelled wait stops nothing.
        Raise MotionRefused, with nothing moved, for a step beyond a limit (see `Board`).
        """
        return await self._runs.run_action(action_id, wait=wait, dry_run=dry_run, ticket=self._ticket)

    async def play(
        self, project: Project, name: int | str, *, playback: Playback | None = None, dry_run: bool = False
    ) -> float:
        """Play an action or a macro of a project without storing it (3.2.5), and return its duration in seconds.

        `name` is a caption, an id, or as in `macro:3`. Each step is sent as a movement when its time comes; the board
        runs no macro. Returns when the servos rest at their last angles.

        Everything is checked before anything moves. Raise ProjectError for a name that is not in the project,
        MotionRefused for a step beyond a limit, NotFound for a record or a servo that is missing, EncodeError for
        values that do not fit, RequestRefused for a servo that is stopped or released, set to ADC, or for a macro that
        never ends.

        `playback.pause()` lets the servos finish the steps that have begun, and `playback.resume()` goes on. A stop, a
        change of an angle unit (RequestRefused) and a lost connection (ConnectionLost) end it: no step is sent twice.
        After a cancellation no further step is sent; the servos finish the one that has begun, unless `stop` is called.
        """
        return await self._playing.play(project, name, playback=playback, dry_run=dry_run)

    # --- 3.3 stored records -------------------------------------------------------------------------------------

    async def actions(self) -> tuple[ActionEntry, ...]:
        """Return id and caption of each stored action (3.3.1)."""
        return await self._records.entries(ACTION)

    async def action(self, action_id: int | str) -> Action:
        """Return a stored action (3.3.2). Raise NotFound if there is none."""
        return await self._records.get(ACTION, action_id)

    async def add_action(self, action: Action) -> Action:
        """Store an action and return it (3.3.3). If its id is 0, it gets the lowest free one.

        Raise Rejected if the board refuses: its memory may be full, or the id may be taken.
        """
        return await self._records.add(ACTION, action)

    async def delete_action(self, action_id: int | str) -> None:
        """Delete a stored action (3.3.4). Raise Rejected if there is none."""
        await self._records.delete(ACTION, action_id)

    async def macros(self) -> tuple[MacroEntry, ...]:
        """Return id and caption of each stored macro (3.3.5)."""
        return await self._records.entries(MACRO)

    async def macro(self, macro_id: int | str) -> Macro:
        """Return a stored macro (3.3.6). Raise NotFound if there is none."""
        return await self._records.get(MACRO, macro_id)

    async def add_macro(self, macro: Macro) -> Macro:
        """Store a macro and return it (3.3.7). If its id is 0, it gets the lowest free one.

        Raise EncodeError if it refers to an action or a macro without an id: add that first, and refer to what
        `add_action` or `add_macro` returned. Raise Rejected if the board refuses.
        """
        return await self._records.add(MACRO, macro)

    async def delete_macro(self, macro_id: int | str) -> None:
        """Delete a stored macro (3.3.8). Raise Rejected if there is none."""
        await self._records.delete(MACRO, macro_id)

    async def run_macro(self, macro_id: int | str, *, wait: bool = False, dry_run: bool = False) -> None:
        """Start a stored macro (3.3.9). Raise NotFound if the board lists none, Rejected if it does not start.

        Returns when the board has answered. With `wait`, everything that the macro runs is read first, and it returns
        when the motion is over, as `run_action` does.

        With limits (see `Board`), each step is checked at the speed that ratios give it. Raise NotFound if a record is
        missing, MotionRefused also for a macro that runs itself. Without limits, `wait` and `dry_run`, only the list of
        macros is read.
        """
        await self._runs.run_macro(macro_id, wait=wait, dry_run=dry_run, ticket=self._ticket)

    async def servo_parameters(self) -> tuple[ServoParameter, ...]:
        """Return caption and angle correction of each servo (3.3.10); empty also after an error on the board."""
        return await self._records.servo_parameters()

    async def add_servo_parameters(self, servos: Iterable[ServoParameter]) -> None:
        """Store caption and angle correction of servos (3.3.11). Raise Rejected if the board refuses."""
        await self._records.add_servo_parameters(servos)

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id (3.3.12). Raise Rejected if the board refuses."""
        await self._session.write_project_id(as_number(project_id))

    async def project_id(self) -> int:
        """Return the project id, 0 if there is none (3.3.13).

        The first time that it marks an unfinished import, a warning is logged.
        """
        return await self._projects.project_id()

    # --- 3.4 joystick -------------------------------------------------------------------------------------------

    async def joystick_tables(self) -> tuple[JoystickTableEntry, ...]:
        """Return id and caption of each stored joystick table (3.4.1)."""
        return await self._records.entries(TABLE)

    async def joystick_table(self, table_id: int | str) -> JoystickTable:
        """Return a stored joystick table (3.4.2). Raise NotFound if there is none."""
        return await self._records.get(TABLE, table_id)

    async def add_joystick_table(self, table: JoystickTable) -> JoystickTable:
        """Store a joystick table and return it (3.4.3). If its id is 0, it gets the lowest free one.

        Raise EncodeError if it refers to a macro without an id, Rejected if the board refuses.
        """
        return await self._records.add(TABLE, table)

    async def delete_joystick_table(self, table_id: int | str) -> None:
        """Delete a stored joystick table (3.4.4). Raise Rejected if there is none."""
        await self._records.delete(TABLE, table_id)

    async def set_active_joystick_table(self, table_id: int | str) -> None:
        """Make a stored joystick table the active one (3.4.5). Raise Rejected if there is none."""
        await self._records.set_active_table(table_id)

    async def active_joystick_table(self) -> int | None:
        """Return the id of the active joystick table, None if the board has no table (3.4.6)."""
        return await self._records.active_table()

    def button_events(self, limit: int = 256) -> ButtonEvents:
        """Return an iterator over button events, which subscribes when it is first used (3.4.7, 3.4.8).

        Up to `limit` unread events are kept; the oldest are dropped and counted.
        """
        from servolink.client.button_events import ButtonEvents

        return ButtonEvents(self._buttons, limit)

    # --- 4 projects: everything stored on the board at once --------------------------------------------------------

    async def export_project(self, *, on_progress: ProgressCallback = ignore_progress) -> Project:
        """Return everything stored on the board, each part from two readings that agree (4.3).

        Raise ProjectError if they never agree, or if the board lists a record that it does not return.
        """
        return await self._projects.export(on_progress)

    async def plan_project(
        self,
        project: Project,
        *,
        replace: bool = False,
        unchecked: bool = False,
        on_progress: ProgressCallback = ignore_progress,
    ) -> Plan:
        """Return what `apply_project` would change and what that costs, without changing anything.

        `unchecked` is for a project read from a board, which may hold values that servolink does not write by itself.
        """
        return await self._projects.plan(project, replace=replace, unchecked=unchecked, on_progress=on_progress)

    async def apply_project(
        self,
        project: Project,
        *,
        replace: bool = False,
        backup: bool = True,
        folder: Path | None = None,
        unchecked: bool = False,
        on_progress: ProgressCallback = ignore_progress,
    ) -> ApplyResult:
        """Make the board hold exactly `project` (4.2): what differs is written, what is not in it is deleted.

        With `replace` everything is deleted and written again. First the content of the board is saved in `folder`
        (by default the user's data folder). After any interruption, a cancellation too, applying again finishes the
        import and `rollback_project` undoes it. `unchecked` is as for `plan_project`. If the project seems not to fit
        the board's memory, a warning is logged. Raise ProjectError if the project cannot be written, if the backup
        fails, or if the board refuses.
        """
        return await self._projects.apply(
            project, replace=replace, backup=backup, folder=folder, unchecked=unchecked, on_progress=on_progress
        )

    async def rollback_project(
        self, backup: Path | None = None, *, folder: Path | None = None, on_progress: ProgressCallback = ignore_progress
    ) -> ApplyResult:
        """Make the board hold what it held before the last import at this address, or what the file `backup` holds.

        Raise ProjectError if there is no such backup, or if the board was changed since that import.
        """
        return await self._projects.roll_back(backup, folder=folder, on_progress=on_progress)

    async def has_unfinished_import(self, *, folder: Path | None = None) -> bool:
        """Return whether an import was interrupted: `apply_project` finishes it, `rollback_project` undoes it.

        The project id of the board says so. Of a board that keeps fewer than 32 bits of it, only the journals in
        `folder` (by default the user's data folder) say so, for this address.
        """
        return await self._projects.has_unfinished_import(folder)


async def send_set_points(board: Board, targets: Mapping[int, float], points: SetPoints, ticket: Ticket) -> None:
    """Send a movement toward the set-points of a stream, shortened by `points` to its limits."""
    await board._servos.stream(targets, points, ticket)  # noqa: SLF001 - for the hub, which sends what programs stream


def with_ticket(board: Board, ticket: Ticket) -> Board:
    """Return `board` for a motion that was asked for when `ticket` was issued, and not when its method is called."""
    one = copy(board)
    one._ticket = ticket  # noqa: SLF001 - a board that only this function makes
    return one
