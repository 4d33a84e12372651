"""Board: every command of the protocol as a method, by chapters of the document."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Coroutine, Iterable
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from servolink.boards import ProfileInUse
from servolink.client.alarms import Alarm, checked_alarms
from servolink.client.board_records import RecordStore
from servolink.client.board_servos import ServoController
from servolink.client.button_events import ButtonEvents, ButtonSubscription
from servolink.client.captions import Targets
from servolink.client.playing import Playback, Playing
from servolink.client.projects import ProjectTransfers
from servolink.client.raw_packets import RawPackets
from servolink.client.servo_readings import ServoReadings, ServoWatch
from servolink.client.servo_state import Servo
from servolink.client.servo_stream import ServoStream, stream_on
from servolink.client.session import Session
from servolink.client.stored_runs import StoredRuns
from servolink.connection import Connection, Stats
from servolink.control import ConnectionState
from servolink.errors import escape, html_table
from servolink.motion import AngleUnit, MotionLimits, MotionPlanner, ServoUnits, Speed, Ticket
from servolink.project import ApplyResult, Plan, ProgressCallback, Project
from servolink.protocol import (
    ACTION,
    ALL_SERVOS,
    MACRO,
    TABLE,
    Action,
    ActionEntry,
    Codec,
    Command,
    JoystickTable,
    JoystickTableEntry,
    Macro,
    MacroEntry,
    Packet,
    Query,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    Request,
    Response,
    SendDummyDataRequest,
    ServoParameter,
    SetServoParameterRequest,
)
from servolink.support import as_number

R = TypeVar("R", bound=Response)


class Board:
    """A connected board, made by `connect`, with a method for each command of the protocol's document, by chapters.

    - Connection: `url`, `codec`, `profile`, `limits`, `connection`, `unanswered`, `stats`, `states`, `request`, `send`,
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
    other ids are 32-bit integers.

    Captions: methods take a caption in place of an id, such as `"hip"`, and `"all"` for all servos. Digits are an id,
    `"name:3"` is the caption `3`. An exact match of upper and lower case comes first. Each call with a caption reads
    the captions from the board; a call with an integer does not.

    Limits: `angle_limits`, `speed_cap` and `soft_start`, of `connect` or of the board's profile, hold for all
    movements. Before a run of stored records, the records are read and each step is checked from the end of the step
    before. With `soft_start`, servos in their first movement (see `move`) then go to their first angles in the run;
    after the arrival everything is checked again, and the run begins.

    Raises:
        RequestTimeout: The board does not answer a query, or a command was not sent. Any method that asks the board.
        OutcomeUnknown: A command was sent, and the board did not answer.
        ConnectionLost: The connection is lost.
        EncodeError: A value does not fit the protocol; nothing was sent.
        NotFound: The board has no servo or record with this id or caption.
        AmbiguousName: Several servos or records have this caption.
        MotionRefused: A step is beyond a limit, or another program moves the board; nothing moved.
        RequestRefused: A stop came before or during a run, or the role of the program does not allow the request.
        TargetNotReached: A servo did not arrive at the first angle of a run in time.
    """

    def __init__(
        self,
        session: Session,
        angle_unit: AngleUnit | None,
        planner: MotionPlanner,
        shared: ServoController | None = None,
        units: ServoUnits | None = None,
    ) -> None:
        """Use `connect` instead."""
        self._session = session
        self._servos = ServoController(session, angle_unit, planner, shared, units)
        self._ticket: Ticket | None = None  # ticket for all motions; None for a new ticket in each call

    @cached_property
    def _packets(self) -> RawPackets:
        return RawPackets(self._session, self._servos, lambda: self._runs)

    @cached_property
    def _records(self) -> RecordStore:
        return RecordStore(self._session)

    @cached_property
    def _buttons(self) -> ButtonSubscription:
        return ButtonSubscription(self._session)

    @cached_property
    def _watch(self) -> ServoWatch:
        return ServoWatch(self._session, self._servos)

    @cached_property
    def _projects(self) -> ProjectTransfers:
        return ProjectTransfers(self._session)

    @cached_property
    def _runs(self) -> StoredRuns:
        return StoredRuns(self._session, self._servos, self._records)

    @cached_property
    def _playing(self) -> Playing:
        return Playing(self._session, self._servos, self._runs)

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
        """The limits of movements: those given to `connect`, tightened by the profile's. Falsy without limits."""
        return self._servos.planner.limits

    @property
    def connection(self) -> Connection:
        """An object that stands for the present connection: another one after a reconnect."""
        return self._servos.connection

    @property
    def unanswered(self) -> frozenset[str]:
        """Names of queries that the board does not answer, such as "QueryProjectID", by profile or on connecting."""
        return self._session.unanswered

    @property
    def stats(self) -> Stats:
        """Counters of the connection: frames, bytes, noise, late responses, round trips."""
        return self._session.stats

    def states(self) -> AsyncGenerator[ConnectionState, None]:
        """Yield the present state (`connected`, `lost` or `closed`), then each change up to `closed`.

        The board of a hub is lost as long as the hub has lost the board.
        """
        return self._session.states()

    def request(
        self, packet: Request[R], *, timeout: float | None = None, unchecked: bool = False
    ) -> Coroutine[Any, Any, R]:
        """Send any packet that the board answers, and return the response, also a negative one.

        With limits, an ExecuteMacroRequest is treated as by `run_macro`.

        Args:
            packet: Request to send.
            timeout: Limit of the whole call, 0.001..3600 seconds, including the wait for other requests; None for the
                `patience` of the connection. For an ExecuteMacroRequest with limits it counts from the sending.
            unchecked: Whether values are allowed that only a board sends, such as control characters in captions. For
                writing back records that were read from the board.
        """
        # A coroutine function would only add a second coroutine to each request.
        if timeout is None and isinstance(packet, Query):  # most requests: nothing is to be checked or kept up to date
            return self._session.connection.request(packet, unchecked=unchecked)
        return self._packets.request(packet, timeout=as_number(timeout), unchecked=unchecked, ticket=self._ticket)

    async def send(self, packet: Command) -> None:
        """Send any packet that the board does not answer.

        With limits, an ExecuteActionExRequest is treated as by `run_action`, and an ExecuteActionRequest is checked,
        with angles in the unit that is set for each servo.

        Raises:
            EncodeError: A movement has a servo twice.
            MotionRefused: A movement is beyond a limit.
        """
        await self._packets.send(packet, ticket=self._ticket)

    async def took_effect(self, request: Packet) -> bool | None:
        """Return whether the board is now in the state that `request` asks for, to follow up on OutcomeUnknown.

        Return None for requests without a readable effect: motions, angle units, the transmission mode and the event
        subscription.
        """
        if isinstance(request, SetServoParameterRequest):
            return await self._servos.all.is_set(request)
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
        """Set mode 1 for this protocol, or 0 for an older protocol without support (3.1.1).

        Raise Rejected if the board reports another mode.
        """
        await self._session.set_transmission_mode(as_number(mode))

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2). Raise Rejected if the board refuses.

        No other request is sent until the board has answered.
        """
        await self._session.clear_all_data()

    async def memory(self) -> QueryMemorySizeResponse:
        """Return the memory: `size` is free, `total_size` is None if the board does not report it (3.1.3).

        The sizes are in bytes if the profile of the board has the unit, and otherwise in the unknown unit of the board.
        A `size` of -1 means that the board does not measure its memory.
        """
        found = await self._session.request(QueryMemorySizeRequest())
        unit = (self.profile and self.profile.settings.memory_unit) or 1
        total = found.total_size
        return QueryMemorySizeResponse(max(-1, found.size * unit), None if total is None or total < 0 else total * unit)

    async def battery(self) -> float | None:
        """Return the remaining charge in percent, to 0.1; None if the board does not measure it (3.1.4)."""
        permil = (await self._session.request(QueryRemainPowerRequest())).permil
        return None if permil < 0 else permil / 10

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
        """Return an iterator over readings of all servos (3.2.2), each with `seconds`, `servos`, `missed` and `alarms`.

        All iterators of a board share the same queries (see `ServoReading`).

        Args:
            hz: Readings per second, above 0 and at most 1000; None for as many as the line allows. A `depth` above 1
                (see `connect`) makes more possible.
            alarms: Alarms to compare with each reading. An alarm with `stops` stops all servos at once.
        """
        return ServoReadings(self._watch, as_number(hz), checked_alarms(alarms))

    async def servo(self, servo_id: int | str) -> Servo:
        """Return the state of one servo (3.2.2). Raise NotFound if the board has no such servo."""
        return await self._servos.servo(servo_id)

    async def set_servo(self, servo_id: int | str, *, start: bool, hold: bool) -> None:
        """Start or stop a servo, and hold its angle or release it (3.2.3).

        Args:
            servo_id: Id or caption of a servo, 255 or `"all"` for all servos.
            start: Whether the servo obeys movements; a stopped servo ignores them.
            hold: Whether the servo holds its angle; a released servo is limp.

        Raises:
            Rejected: The board reports another state.
        """
        await self._servos.set_servo(servo_id, start=start, hold=hold, ticket=self._ticket)

    async def release(self, servo_id: int | str = ALL_SERVOS) -> None:
        """Stop and release a servo, or all servos (3.2.3). A released servo is limp, and a raised limb falls."""
        await self._servos.set_servo(servo_id, start=False, hold=False, ticket=self._ticket)

    async def stop(self) -> None:
        """Stop all servos at their present angles and hold them, ahead of all other requests (3.2.3).

        Returns when all servos report that they are stopped and held. A stopped servo ignores movements until
        `set_servo(..., start=True, hold=True)`.

        Raises:
            OutcomeUnknown: Some servos do not report that they are stopped and held.
        """
        await self._servos.stop()

    async def set_angle_unit(self, unit: AngleUnit, servo_id: int | str = ALL_SERVOS) -> None:
        """Set the unit of a servo's angles, `degree` or `adc` (3.2.4). Raise Rejected if the board refuses."""
        await self._servos.units.set(unit, servo_id)

    def unit_of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo's angles by its id, None if unknown. Asks nothing of the board."""
        return self._servos.units.of(servo_id)

    @property
    def units(self) -> ServoUnits:
        """Angle units known to be set on the board. Only `set_angle_unit` changes the units."""
        return self._servos.units.current

    async def move(
        self,
        targets: Targets,
        *,
        duration: float | None = None,
        speed: Speed | None = None,
        wait: bool = False,
        dry_run: bool = False,
        start: bool = False,
        any_angle: bool = False,
    ) -> float:
        """Move servos together to angles in degrees (or `Adc`), and return the duration in seconds (3.2.5).

        Returns when the movement is sent, or with `wait`, when all servos have arrived. The board reports no errors of
        movements, so a movement that servos would ignore is refused before anything is sent. The list of servos is
        read once for that; further queries are sent only before a refusal, and the servos are read after a stop.

        The first movement of a servo is the first on a new connection, or after a stop or release of the servo, and
        lasts until its planned end. With `soft_start`, the whole movement takes longer if a servo in its first movement
        would be too fast.

        Args:
            targets: Angles by id or caption.
            duration: Seconds, 0.01..327.67. Give either `duration` or `speed`.
            speed: Degrees per second for all servos, or by servo id. The present angles are read first.
            wait: Whether to wait until the servos are within 2 degrees of their targets.
            dry_run: Whether to check and return the duration, and send nothing.
            start: Whether to start and hold servos first that are stopped or released.
            any_angle: Whether angles beyond ±360 degrees are sent to servos without `angle_limits`, and servos moved
                whose readings cannot be true.

        Raises:
            NotFound: The board has no such servo.
            MotionRefused: An angle is outside `angle_limits` or beyond a whole turn, a speed is above `speed_cap`, or
                another program moves the board. Nothing moved.
            RequestRefused: A servo is stopped or released, by this program or as a reading has shown.
            TargetNotReached: With `wait`, a servo has not arrived a second after the planned end.
        """
        servos, ticket = self._servos, self._ticket or self._session.ticket()
        movement = await servos.movement(targets, duration=duration, speed=speed, any_angle=any_angle)
        if dry_run:
            return (await servos.plan(movement, ticket, start=start)).seconds
        plan = await servos.move(movement, ticket, start=start)
        if wait:
            await servos.until_over(plan, ticket)
        return plan.seconds

    def stream(self, hz: float = 50.0, *, gap: float = 0.5, any_angle: bool = False) -> ServoStream:
        """Return a stream of set-points (3.2.5), as from a gamepad or a policy.

        `await stream.send({1: 30.5})` turns servos toward angles in degrees, and returns the angles sent. Limits
        shorten a movement in place of refusing it: each target is the nearest whole angle within `angle_limits`, and no
        farther than `speed_cap` and `soft_start` allow. A movement begins at the present angle on the way to the last
        target, or at a reading after 0.5 s without a set-point and after any other movement.

        A newer set-point replaces an unsent one. A stop, a loss of the connection, or a gap ends the stream; the servos
        keep their last targets.

        Args:
            hz: Most set-points per second, above 0 and at most 100.
            gap: Seconds without a set-point that end the stream, above 0 and at most 10.
            any_angle: Whether set-points beyond ±360 degrees are sent to servos without `angle_limits`.
        """
        return stream_on(self._session, self._servos, hz, gap, self._ticket, any_angle=any_angle)

    def follow(
        self, targets: Targets, seconds: float, *, settle: bool = False
    ) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Read all servos every 40 ms (3.2.2), until `seconds` are over and the servos in `targets` have arrived.

        Args:
            targets: Angles by id or caption, as given to `move`.
            seconds: Duration of the movement, as returned by `move`.
            settle: Whether to read on until two readings are equal.

        Raises:
            TargetNotReached: A servo has not arrived a second after the planned end.
            OutcomeUnknown: The board does not answer during the movement.
            RequestRefused: A stop ended the movement.
            ConnectionLost: The connection was lost meanwhile.
        """
        return self._servos.follow(targets, as_number(seconds), settle=settle)

    async def run_action(
        self, action_id: int | str, *, wait: bool = False, dry_run: bool = False, any_angle: bool = False
    ) -> float:
        """Run a stored action (3.2.6), and return its duration in seconds.

        Returns when the command is sent, as the board does not answer it. A cancelled wait stops nothing. The servos
        are read once before.

        Args:
            action_id: Id or caption.
            wait: Whether to wait until the duration is over and the servos rest at their last angles.
            dry_run: Whether to check and return the duration, and send nothing.
            any_angle: Whether servos are moved whose readings cannot be true.

        Raises:
            NotFound: The board has no such action.
            MotionRefused: A step is beyond a limit (see `Board`), or a servo in the run reports values that cannot be
                true. Nothing moved.
            TargetNotReached: With `wait`, servos are not within 2 degrees of their last angles a second after the end.
            RequestRefused: A stop ended the run.
        """
        return await self._runs.run_action(
            action_id, wait=wait, dry_run=dry_run, any_angle=any_angle, ticket=self._ticket
        )

    async def play(
        self,
        project: Project,
        name: int | str,
        *,
        playback: Playback | None = None,
        dry_run: bool = False,
        start: bool = False,
        any_angle: bool = False,
    ) -> float:
        """Play an action or a macro of a project without storing it (3.2.5), and return its duration in seconds.

        Each step is sent as a movement at its time, and never twice; the board runs no macro. Returns when the servos
        rest at their last angles. After a cancellation no further step is sent, and the servos finish the present step
        unless `stop` is called.

        Args:
            project: Project with the record.
            name: Caption, id, or both kinds as in `macro:3`.
            playback: Control of the run: `playback.pause()` lets the servos finish the present steps, and
                `playback.resume()` continues.
            dry_run: Whether to check and return the duration, and send nothing.
            start: As for `move`.
            any_angle: As for `move`.

        Raises:
            ProjectError: The project has no such record.
            NotFound: A record or a servo in the run is missing.
            EncodeError: A value does not fit the protocol.
            MotionRefused: A step is beyond a limit or a whole turn. Nothing moved.
            RequestRefused: A servo is stopped, released or set to ADC, a macro never ends, a stop ended the run, or an
                angle unit was set meanwhile.
            ConnectionLost: The connection was lost during the run.
        """
        return await self._playing.play(
            project, name, playback=playback, dry_run=dry_run, start=start, any_angle=any_angle
        )

    # --- 3.3 stored records -------------------------------------------------------------------------------------

    async def actions(self) -> tuple[ActionEntry, ...]:
        """Return id and caption of each stored action (3.3.1)."""
        return await self._records.entries(ACTION)

    async def action(self, action_id: int | str) -> Action:
        """Return a stored action (3.3.2). Raise NotFound if there is none."""
        return await self._records.get(ACTION, action_id)

    async def add_action(self, action: Action) -> Action:
        """Store an action (3.3.3), and return the stored action: an id of 0 becomes the lowest free id.

        Raises:
            Rejected: The board refuses; its memory may be full, or the id may be taken.
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
        """Store a macro (3.3.7), and return the stored macro: an id of 0 becomes the lowest free id.

        Raises:
            EncodeError: The macro refers to an action or a macro without an id. Add that record first, and refer to the
                result of `add_action` or `add_macro`.
            Rejected: The board refuses; its memory may be full, or the id may be taken.
        """
        return await self._records.add(MACRO, macro)

    async def delete_macro(self, macro_id: int | str) -> None:
        """Delete a stored macro (3.3.8). Raise Rejected if there is none."""
        await self._records.delete(MACRO, macro_id)

    async def run_macro(
        self, macro_id: int | str, *, wait: bool = False, dry_run: bool = False, any_angle: bool = False
    ) -> None:
        """Start a macro that is stored on the board (3.3.9).

        Returns when the board has answered. Without limits, `wait` and `dry_run`, only the list of macros and once
        the servos are read first; otherwise all records in the run. Each step is checked at the speed that its ratios
        give.

        Args:
            macro_id: Id or caption.
            wait: Whether to wait for the end of the motion, as `run_action` does.
            dry_run: Whether to check only, and send nothing.
            any_angle: Whether servos are moved whose readings cannot be true.

        Raises:
            NotFound: The board has no such macro, or a record in the run is missing.
            Rejected: The board does not start the macro.
            MotionRefused: A step is beyond a limit, a servo in the run reports values that cannot be true, or with
                limits, the macro runs itself. Nothing moved.
            TargetNotReached: With `wait`, servos are not within 2 degrees of their last angles a second after the end.
            RequestRefused: A stop ended the run.
        """
        await self._runs.run_macro(macro_id, wait=wait, dry_run=dry_run, any_angle=any_angle, ticket=self._ticket)

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

        A warning is logged the first time that the id marks an unfinished import.
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
        """Store a joystick table (3.4.3), and return the stored table: an id of 0 becomes the lowest free id.

        Raises:
            EncodeError: A button refers to a macro without an id.
            Rejected: The board refuses; its memory may be full, or the id may be taken.
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
        """Return an iterator over button events, which subscribes on first use (3.4.7, 3.4.8).

        Args:
            limit: Most unread events to keep; then the oldest are dropped and counted.
        """
        return ButtonEvents(self._buttons, limit)

    # --- 4 projects: everything stored on the board at once --------------------------------------------------------

    async def export_project(self, *, on_progress: ProgressCallback | None = None) -> Project:
        """Return everything stored on the board, each part from two equal readings (4.3).

        Args:
            on_progress: Function called with the progress; None for none.

        Raises:
            ProjectError: Two readings are never equal, or the board lists a record that it does not return.
        """
        return await self._projects.export(on_progress)

    async def plan_project(
        self,
        project: Project,
        *,
        replace: bool = False,
        unchecked: bool = False,
        on_progress: ProgressCallback | None = None,
    ) -> Plan:
        """Return the changes by `apply_project` and their cost, and change nothing.

        Args:
            project: Project to compare with the board.
            replace: As for `apply_project`.
            unchecked: As for `apply_project`.
            on_progress: Function called with the progress; None for none.
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
        on_progress: ProgressCallback | None = None,
    ) -> ApplyResult:
        """Make the board hold exactly `project` (4.2): write the differences, and delete all other records.

        After any interruption, also a cancellation, another call finishes the import, and `rollback_project` undoes it.
        A warning is logged for a project that seems too large for the board's memory.

        Args:
            project: Project to write.
            replace: Whether to delete everything and write all records again.
            backup: Whether to save the content of the board first.
            folder: Folder of the backups and journals; None for the user's data folder.
            unchecked: Whether values are allowed that only a board sends. For a project that was read from a board.
            on_progress: Function called with the progress; None for none.

        Raises:
            ProjectError: The project cannot be written, the backup fails, or the board refuses.
        """
        return await self._projects.apply(
            project, replace=replace, backup=backup, folder=folder, unchecked=unchecked, on_progress=on_progress
        )

    async def rollback_project(
        self, backup: Path | None = None, *, folder: Path | None = None, on_progress: ProgressCallback | None = None
    ) -> ApplyResult:
        """Restore the content of the board before the last import at this address, or a backup.

        Args:
            backup: File of the backup; None for that of the last import.
            folder: Folder of the backups and journals; None for the user's data folder.
            on_progress: Function called with the progress; None for none.

        Raises:
            ProjectError: There is no such backup, or the board was changed since that import.
        """
        return await self._projects.roll_back(backup, folder=folder, on_progress=on_progress)

    async def has_unfinished_import(self, *, folder: Path | None = None) -> bool:
        """Return whether an import was interrupted: `apply_project` finishes it, `rollback_project` undoes it.

        The project id of the board marks an unfinished import. For a board that keeps fewer than 32 bits of the id, the
        journals of this address decide.

        Args:
            folder: Folder of the journals; None for the user's data folder.
        """
        return await self._projects.has_unfinished_import(folder)


def servos_of(board: Board) -> ServoController:
    """Return the controller of the servos of `board`."""
    return board._servos  # noqa: SLF001 - for the hub, which sends for programs what no method of `Board` does


def with_ticket(board: Board, ticket: Ticket) -> Board:
    """Return `board` with `ticket` for all motions, in place of a new ticket at each call."""
    one = copy(board)
    one._ticket = ticket  # noqa: SLF001 - a board that only this function makes
    return one
