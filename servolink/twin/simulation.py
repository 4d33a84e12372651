"""Body in motion: a virtual board turns the servos of the body, and the clock of MuJoCo is the clock of the board."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from copy import copy
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final

from servolink.errors import TwinError, escape, install_extra, quote
from servolink.twin.body import Body, Drive
from servolink.twin.mjcf import BASE, FLOOR, model_text, part_names, servo_joint
from servolink.virtual import Hardware

TICK: Final = 0.01
"""Seconds between two looks of the servos at their board."""
STEP: Final = 0.002
"""Seconds of a step of the physics; a tick has a whole number of steps."""

_logger = logging.getLogger(__name__)
_DEGREES = 180 / math.pi
_DEEPEST = 1e-3  # metres by which parts may overlap at rest


def mujoco() -> Any:
    """Return the module of MuJoCo. Raise TwinError without the extra `twin`."""
    try:
        found = import_module("mujoco")
    except ImportError as error:
        reason = str(error).strip().rpartition("\n")[2]  # NumPy gives a page of advice first
        raise TwinError(f"the twin needs MuJoCo; {install_extra('twin')} ({reason})") from error
    # MuJoCo prints its warnings otherwise, and writes them to MUJOCO_LOG.TXT in whatever folder is the present one.
    found.set_mju_user_warning(_logger.debug)
    return found


def is_installed() -> bool:
    """Return whether MuJoCo is installed."""
    return find_spec("mujoco") is not None


def checked_model(body: Body) -> str:
    """Return the MJCF text of a body; where MuJoCo is installed, only of one that MuJoCo can build.

    Raise TwinError for another one.
    """
    if is_installed():
        Physics(body)
    return model_text(body)


class Physics:
    """Model of a body in MuJoCo, and the state of all its parts.

    Attributes `model` and `data` are those of MuJoCo, for whatever is not here.
    """

    def __init__(self, body: Body, step: float = STEP) -> None:
        """Put the body at rest. Raise TwinError for parts that overlap, or without MuJoCo."""
        self._mujoco = mujoco()
        self.body = body
        try:
            self.model = self._mujoco.MjModel.from_xml_string(model_text(body, step))
        except ValueError as error:
            raise TwinError(f"figure: MuJoCo cannot build the body: {escape(str(error))}") from error
        self.data = self._mujoco.MjData(self.model)
        self._bodies = [self.model.body(name).id for name in part_names(body)]
        self._names = {0: FLOOR, **{number: part.name for number, part in zip(self._bodies, body.parts, strict=True)}}
        self.servo_ids = tuple(body.drives)
        """Servos in the order of the actuators of the model."""
        self._feet = [number for number in self._bodies if self._names[number] in body.feet]
        joints = [self.model.joint(servo_joint(servo_id)) for servo_id in self.servo_ids]
        self.positions = [int(joint.qposadr[0]) for joint in joints]
        """Places of the servos in `data.qpos`."""
        self._original = copy(self.model)
        self.reset()
        self._refuse_overlap()

    def reset(self, degrees: Mapping[int, float] | None = None) -> None:
        """Put the body at rest, with all servos at 0 or at the nearest limit, at the time 0.

        With `degrees` by servo id, these servos are there instead, and the base of the body still is where it rests.
        """
        self._mujoco.mj_resetData(self.model, self.data)
        for part, number in zip(self.body.parts, self._bodies, strict=True):
            if part.servo is not None:
                angle = part.rest if degrees is None else degrees.get(part.servo, part.rest * _DEGREES) / _DEGREES
                at = self.model.jnt_qposadr[self.model.body_jntadr[number]]
                self.data.qpos[at] = min(max(angle, part.limits[0]), part.limits[1])
        self.data.ctrl[:] = self.data.qpos[self.positions]
        self.model.actuator_forcerange[:] = self._original.actuator_forcerange
        self._mujoco.mj_forward(self.model, self.data)

    def pose(self, degrees: Mapping[int, float], *, sunk: float = 0.0) -> None:
        """Put the body at rest with servos at `degrees` by id: its lower foot flat, and its lowest part on the floor.

        A body without feet keeps its base upright. With `sunk` metres below the floor, all that is near it touches.
        """
        self.reset()
        foot_at = {number: (self.data.xpos[number].copy(), self.data.xmat[number].copy()) for number in self._feet}
        self.reset(degrees)
        if self.body.bolted:
            return
        data, base = self.data, self.model.body(BASE).id
        if self._feet:
            foot = min(self._feet, key=lambda number: float(data.xpos[number][2]))
            place, turn = foot_at[foot]
            back = turn.reshape(3, 3) @ data.xmat[foot].reshape(3, 3).T
            data.qpos[:3] = place + back @ (data.xpos[base] - data.xpos[foot])
            self._mujoco.mju_mat2Quat(data.qpos[3:7], (back @ data.xmat[base].reshape(3, 3)).flatten())
            self._mujoco.mj_kinematics(self.model, data)
        data.qpos[2] -= self._lowest() + sunk
        self._mujoco.mj_forward(self.model, data)

    def _lowest(self) -> float:
        """Return the height of the lowest point of the body, in metres."""
        solid = self.model.geom_bodyid > 0
        is_box = self.model.geom_type[solid] == self._mujoco.mjtGeom.mjGEOM_BOX
        size, down = self.model.geom_size[solid], abs(self.data.geom_xmat[solid][:, 6:])
        box = (size * down).sum(axis=1)
        cylinder = size[:, 1] * down[:, 2] + size[:, 0] * (1 - down[:, 2] ** 2).clip(0) ** 0.5
        reach = box * is_box + cylinder * ~is_box
        return float((self.data.geom_xpos[solid][:, 2] - reach).min())

    def forces(self) -> dict[tuple[str, str], float]:
        """Return the newtons with which parts press on each other or on the floor, by pair as in `touching`."""
        force, found = self.data.xfrc_applied[0].copy(), dict[tuple[str, str], float]()
        for at, pair in enumerate(self.model.geom_bodyid[self.data.contact.geom].tolist()):
            one, other = sorted(self._names[number] for number in pair)
            self._mujoco.mj_contactForce(self.model, self.data, at, force)
            found[one, other] = found.get((one, other), 0.0) + float(force[0])
        return found

    def vary(self, *, mass: float = 1.0, stiffness: float = 1.0, friction: float = 1.0) -> None:
        """Multiply masses, stiffness of servos and friction of the body by factors."""
        model, original = self.model, self._original
        model.body_mass[:] = original.body_mass * mass
        model.body_inertia[:] = original.body_inertia * mass
        model.actuator_gainprm[:, 0] = original.actuator_gainprm[:, 0] * stiffness
        model.actuator_biasprm[:, 1] = original.actuator_biasprm[:, 1] * stiffness
        model.geom_friction[:, 0] = original.geom_friction[:, 0] * friction
        self._mujoco.mj_setConst(model, self.data)

    def advance(self, steps: int) -> None:
        """Advance the physics by a number of steps."""
        self._mujoco.mj_step(self.model, self.data, steps)

    def release(self, at: int, *, released: bool) -> None:
        """Take the torque from the servo at a place of `servo_ids`, or give the torque back."""
        self.model.actuator_forcerange[at] = 0.0 if released else self._original.actuator_forcerange[at]

    def set_drive(self, at: int, drive: Drive) -> None:
        """Give the servo at a place of `servo_ids` another drive."""
        for model in (self.model, self._original):
            joint = model.actuator_trnid[at, 0]
            model.dof_damping[model.jnt_dofadr[joint]] = drive.damping
            model.dof_armature[model.jnt_dofadr[joint]] = drive.armature
            model.actuator_gainprm[at, 0] = drive.stiffness
            model.actuator_biasprm[at, 1:3] = -drive.stiffness, -drive.derivative
            model.actuator_forcerange[at] = -drive.torque, drive.torque

    def angle(self, at: int) -> float:
        """Return the angle in degrees of the servo at a place of `servo_ids`, as the body has it."""
        return float(self.data.qpos[self.positions[at]]) * _DEGREES

    def touching(self) -> set[tuple[str, str]]:
        """Return the names of the parts that touch each other or the floor, each pair in order of names."""
        names = [self._names[int(number)] for number in self.model.geom_bodyid[self.data.contact.geom].flat]
        return {(min(pair), max(pair)) for pair in zip(names[::2], names[1::2], strict=True)}

    def _refuse_overlap(self) -> None:
        for contact in self.data.contact:
            one, other = (self._names[int(self.model.geom_bodyid[geom])] for geom in contact.geom)
            if contact.dist < -_DEEPEST and FLOOR not in {one, other}:
                raise TwinError(
                    f"figure.joints: {quote(one)} and {quote(other)} overlap at rest by {-1000 * contact.dist:.1f} mm; "
                    'move their shapes apart, or add both to "touching" in the body of the figure'
                )


class Simulation:
    """Body with the hardware of a virtual board: the servos of the board are the commands of the servos of the body."""

    def __init__(self, physics: Physics, hardware: Hardware, pose: Mapping[int, float] | None = None) -> None:
        """Put body and servos at rest, or in a pose (see `Physics.pose`), at the time 0 of body and board."""
        self.physics = physics
        self.hardware = hardware
        self._steps = round(TICK / physics.model.opt.timestep)
        self._ticks = 0
        self._released = set[int]()
        if pose is None:
            physics.reset()
        else:
            physics.pose(pose)
        self._servos = [
            (at, servo) for at, one in enumerate(physics.servo_ids) if (servo := hardware.servos.get(one)) is not None
        ]
        for at, servo in self._servos:
            servo.angle = physics.angle(at)

    @property
    def now(self) -> float:
        """Simulated time in seconds, for body and board."""
        return self._ticks * TICK

    def advance(self, until: float) -> None:
        """Advance board and body by whole ticks up to the time `until`, at most a tick later."""
        while self.now < until - TICK / 1000:
            self.tick()

    def tick(self) -> None:
        """Advance board and body by a tick."""
        now = self.now
        is_held = not self._released and all(servo.is_hold for _, servo in self._servos)
        if self.hardware.next_due(now) == now or not is_held:
            self.hardware.advance(now)
            self.turn()
            return
        control = self.physics.data.ctrl
        for at, servo in self._servos:
            if servo.moving:
                servo.advance(now)
                control[at] = servo.angle / _DEGREES
        self._step()

    def turn(self) -> None:
        """Advance the body by a tick, with the angles of the servos of the board as commands."""
        control = self.physics.data.ctrl
        for at, servo in self._servos:
            if not servo.is_hold:
                servo.push(self.physics.angle(at))
            if servo.is_hold == (at in self._released):
                self._change(at, released=not servo.is_hold)
            control[at] = servo.angle / _DEGREES
        self._step()

    def _step(self) -> None:
        self.physics.advance(self._steps)
        self._ticks += 1

    def _change(self, at: int, *, released: bool) -> None:
        self.physics.release(at, released=released)
        self._released ^= {at}
