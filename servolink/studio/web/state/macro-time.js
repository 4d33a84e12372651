// Times of the steps of a macro, as in `MacroPlaying` of `servolink/protocol/records.py`: all steps of an action start
// together, and the action lasts as long as the longest step. A command lasts for its total interval, or longer if its
// record does.

import { inOrder } from "./durations.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Command} Command */
/** @typedef {import("./records.js").Pose} Pose */
/**
 * One turn of a servo.
 * @typedef {{ servoId: number, from: number, until: number, start: number | undefined, end: number, clip: number }} Turn
 * `start` is undefined while the pose before is unknown; `clip` is the index of the command of the macro that leads to it.
 */
/**
 * A command of the macro, or of a macro inside.
 * @typedef {{ command: Command, index: number, depth: number, from: number, until: number, isAgain: boolean }} Clip
 */
/** @typedef {{ clips: Clip[], turns: Turn[], seconds: number, isCut: boolean }} Course */

const MOST_CLIPS = 4000;

/**
 * Return the course of a macro from the pose `start`; null for an endless or missing macro.
 * @param {Project} project
 * @param {number} macroId
 * @param {Pose} [start]
 * @param {number} [slowness] how many times longer than stored an interval is on the board
 * @returns {Course | null}
 */
export function courseOf(project, macroId, start = {}, slowness = 1) {
  const macros = inOrder(project.macros),
    macro = macros.get(macroId);
  if (macro === undefined) return null;
  const player = new Player(project, macros, { ...start }, slowness);
  player.play(macro, 1, 0, false, 0);
  return { clips: player.clips, turns: player.turns, seconds: player.now, isCut: player.isCut };
}

class Player {
  /**
   * @param {Project} project
   * @param {Map<number, Macro>} macros
   * @param {Pose} pose
   * @param {number} slowness
   */
  constructor(project, macros, pose, slowness) {
    this.clips = /** @type {Clip[]} */ ([]);
    this.turns = /** @type {Turn[]} */ ([]);
    this.now = 0;
    this.isCut = false;
    this._actions = new Map(project.actions.map((action) => [action.action_id, action]));
    this._macros = macros;
    this._pose = pose;
    this._slowness = slowness;
  }

  /**
   * @param {Macro} macro
   * @param {number} speed
   * @param {number} depth
   * @param {boolean} isAgain whether this is a repeat
   * @param {number} top index of the command of the outermost macro
   */
  play(macro, speed, depth, isAgain, top) {
    macro.commands.forEach((command, index) => {
      const from = this.now,
        at = depth === 0 ? index : top;
      const clip = { command, index, depth, from, until: from, isAgain };
      if (this.clips.length >= MOST_CLIPS) this.isCut = true;
      if (this.isCut) return;
      this.clips.push(clip);
      if (command.ratio_percent > 0) this._repeat(command, (speed * command.ratio_percent) / 100, depth, isAgain, at);
      this.now = Math.max(this.now, from + command.total_interval_ms / 1000 / speed);
      clip.until = this.now;
    });
  }

  /**
   * @param {Command} command
   * @param {number} speed
   * @param {number} depth
   * @param {boolean} isAgain
   * @param {number} top
   */
  _repeat(command, speed, depth, isAgain, top) {
    for (let count = 0; count < command.loop && !this.isCut; count++) {
      if (command.type === "delay") this.now += Math.max(0, command.delay_ms ?? 0) / 1000 / speed;
      if (command.type === "action") this._act(command.action_id ?? 0, speed, top);
      const called = command.type === "macro" ? this._macros.get(command.macro_id ?? 0) : undefined;
      if (called) this.play(called, speed, depth + 1, isAgain || count > 0, top);
      if (this.turns.length > MOST_CLIPS * 8) this.isCut = true;
    }
  }

  /**
   * @param {number} actionId
   * @param {number} speed
   * @param {number} top
   */
  _act(actionId, speed, top) {
    const from = this.now,
      before = this._pose;
    this._pose = { ...before };
    for (const step of this._actions.get(actionId)?.steps ?? []) {
      const until = from + (step.interval_ms / 1000 / speed) * this._slowness;
      this.turns.push({
        servoId: step.servo_id,
        from,
        until,
        start: before[step.servo_id],
        end: step.degree,
        clip: top,
      });
      this._pose[step.servo_id] = step.degree;
      this.now = Math.max(this.now, until);
    }
  }
}

/**
 * Return the pose at a moment of a course; servos that were not moved yet keep their angle in `start`.
 * @param {Course} course
 * @param {Pose} start
 * @param {number} seconds
 * @returns {Pose}
 */
export function poseAt(course, start, seconds) {
  const pose = { ...start };
  for (const turn of course.turns) {
    if (turn.from > seconds) break;
    const done = seconds >= turn.until ? 1 : (seconds - turn.from) / (turn.until - turn.from);
    const from = turn.start ?? turn.end;
    pose[turn.servoId] = from + (turn.end - from) * done;
  }
  return pose;
}

/**
 * Return how fast a turn is, degrees per second; infinite without time, 0 if nothing turns or it is not known from where.
 * @param {{ start: number | undefined, end: number, from: number, until: number }} turn
 */
export function speedOf({ start, end, from, until }) {
  const way = Math.abs(end - (start ?? end));
  return way === 0 ? 0 : way / (until - from);
}
