// The only part of the page that moves the robot: while something is held, never otherwise.

import { effect, signal } from "../html.js";
import { Beats } from "../link/beats.js";
import { RequestError } from "../link/link.js";
import { isMine, linkState, problem, servos } from "./robot.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** One movement of several: when it begins and how long it takes, seconds. @typedef {{ at: number, duration: number, targets: Pose }} Part */

const DEAD_MAN = 0.35; // seconds without a beat after which the hub stops the robot
const PERIOD = 40; // milliseconds between two movements, at least
const SHORTEST = 0.08; // seconds
const LEAST = 0.01; // seconds, as the board counts them
const SAME = 2; // degrees by which a servo may miss its target
const LATE = 1; // seconds that a stored motion may take longer than it says

/** What the person wants the servos to do, as far as it was sent or is about to be. */
export const targets = signal(/** @type {Pose} */ ({}));
/** Why the latest movement was refused, empty if it was not. */
export const refusal = signal("");
/** The stored motion that runs because this page started it. */
export const running = signal(/** @type {{ type: "action" | "macro", id: number } | null} */ (null));
/** How fast servos follow what is dragged, degrees per second. */
export const pace = signal(120);

/** Moves the robot of one connection. */
export class Motion {
  /** @param {Link} link */
  constructor(link) {
    this._link = link;
    this._beats = new Beats(() => this._link.tell("lease.beat"));
    this._isHeld = false;
    /** @type {Pose | null} */
    this._wanted = null;
    this._isSending = false;
    this._sentAt = 0;
    this._playing = {};
    this._wake = () => {};
    this._runsUntil = 0; // milliseconds of `performance.now()`
    this._arrivesAt = 0; // the same, for what was moved last; Infinity until that is known
    /** @type {Promise<void> | null} */
    this._ending = null;
    effect(() => {
      if (!isMine.value || linkState.value !== "open") this._letGo(); // somebody took over, or the connection is gone
    });
    link.on("stopped", () => this._letGo()); // nothing of what was wanted before a stop is sent after it
    for (const [target, name] of /** @type {[EventTarget, string][]} */ ([
      [window, "blur"],
      [window, "pagehide"],
      [document, "visibilitychange"],
    ])) {
      target.addEventListener(name, () => {
        if (name !== "visibilitychange" || document.hidden) this.leave();
      });
    }
  }

  /**
   * Begin to hold. Return whether the robot may be moved now.
   * @param {{ force?: boolean }} [options]
   */
  async begin({ force = false } = {}) {
    this._isHeld = true;
    refusal.value = "";
    await this._ending; // until then, servos are stopped
    try {
      await this._link.call("lease.take", { dead_man: DEAD_MAN, force });
    } catch (error) {
      this._letGo();
      this._refused(error);
      return false;
    }
    this._beats.start();
    return this._isHeld; // it may have been let go of meanwhile
  }

  /**
   * Move towards a pose while it is held; what was wanted before and was not sent is forgotten.
   * @param {Pose} pose
   */
  towards(pose) {
    if (!this._isHeld) return;
    targets.value = { ...targets.value, ...pose };
    this._wanted = { ...this._wanted, ...pose };
    if (!this._isSending) this._send();
  }

  /**
   * Play movements one after the other while it is held. Return whether all of them were played.
   * @param {Part[]} parts in the order of their times
   * @param {number} seconds how long all of it takes
   * @param {(seconds: number) => void} [onTime] called with the time of each movement when it is sent
   */
  async play(parts, seconds, onTime = () => {}) {
    const playing = (this._playing = {});
    let start = performance.now();
    for (const { at, duration, targets: pose } of [...parts, { at: seconds, duration: 0, targets: {} }]) {
      await this._until(start + at * 1000);
      if (!this._isHeld || this._playing !== playing) return false;
      start = Math.max(start, performance.now() - at * 1000); // late: each movement gets its full time all the same
      onTime(at);
      if (Object.keys(pose).length > 0) await this._move(pose, Math.max(LEAST, duration));
    }
    return this._isHeld && this._playing === playing;
  }

  /** Let go: servos that still turn stop where they are. */
  end() {
    if (!this._isHeld) return;
    this._isHeld = false;
    this._wanted = null;
    this._wake();
    const moving = this._moving();
    targets.value = {};
    if (moving.length === 0 || !isMine.value) return;
    const ending = (this._ending = this._stopMoving(moving).finally(
      () => this._ending === ending && (this._ending = null),
    ));
  }

  /**
   * Run what is stored on the board, watched over by this page: it is stopped when the page or the screen is left.
   * Return whether it runs.
   * @param {"action" | "macro"} type
   * @param {number} id
   * @param {number} seconds how long it takes
   */
  async run(type, id, seconds) {
    this._runsUntil = Infinity;
    if (!(await this.begin())) return false;
    try {
      await this._link.call("run", { type, id });
    } catch (error) {
      this._runsUntil = 0;
      this._refused(error);
      return false;
    }
    this._runsUntil = performance.now() + (seconds + LATE) * 1000;
    const mine = (running.value = { type, id });
    setTimeout(() => running.value === mine && (running.value = null), seconds * 1000);
    return true;
  }

  /** Whether something that was started by `run` may still turn servos. */
  get isRunning() {
    return performance.now() < this._runsUntil;
  }

  /** Stop what `run` started, if it is not over. Return whether there was anything to stop. */
  endRun() {
    if (!this.isRunning) return false;
    this.stop().catch(() => {}); // without a connection, the hub stops the robot
    return true;
  }

  /** Let go, and give the lease back: this page is not looked at any more. */
  leave() {
    this.end();
    this.endRun();
    if (this._ending === null) this._give();
    else this._ending.then(() => this._isHeld || this._give());
  }

  _give() {
    if (isMine.value) this._link.tell("lease.give");
    this._beats.stop();
  }

  /** Stop all servos at once, whoever moves them. */
  async stop() {
    this._letGo();
    await this._link.call("stop");
  }

  /** Start all servos; they hold where they are. */
  async startAll() {
    await this._link.call("servo.set", { servo: "all", start: true, hold: true });
  }

  /**
   * Wait until a time of `performance.now()`, or until it is let go.
   * @param {number} time
   */
  _until(time) {
    return new Promise((done) => {
      const timer = setTimeout(done, Math.max(0, time - performance.now()));
      this._wake = () => {
        clearTimeout(timer);
        done(undefined);
      };
    });
  }

  /**
   * @param {Pose} pose
   * @param {number} duration seconds
   */
  async _move(pose, duration) {
    targets.value = { ...targets.value, ...pose };
    await this._call(pose, duration);
  }

  /**
   * @param {Pose} pose
   * @param {number} duration seconds
   */
  async _call(pose, duration) {
    this._arrivesAt = Infinity;
    try {
      const { seconds } = await this._link.call("move", { targets: pose, duration });
      this._arrivesAt = performance.now() + seconds * 1000;
    } catch (error) {
      if (this._isHeld) this._refused(error); // or it was let go of, and that came first
    }
  }

  /** Return the servos that this page moves and that may still turn: readings alone may be old. */
  _moving() {
    const isOver = performance.now() >= this._arrivesAt;
    return Object.entries(targets.value).flatMap(([key, target]) => {
      const id = Number(key),
        servo = servos.value.get(id);
      const rests = servo === undefined || !isReady(servo) || (isOver && Math.abs(servo.angle - target) <= SAME);
      return rests ? [] : [id];
    });
  }

  /** @param {number[]} ids */
  async _stopMoving(ids) {
    const isOneStop = ids.length > 1 && [...servos.value.values()].every(isReady); // then all are the same afterwards
    try {
      await this._link.call("move.end", { servos: isOneStop ? null : ids });
    } catch (error) {
      if (error instanceof RequestError) problem.value = error.message; // without a connection, the hub stops the robot
    }
  }

  async _send() {
    this._isSending = true;
    while (this._wanted !== null && this._isHeld) {
      const pause = this._sentAt + PERIOD - performance.now();
      if (pause > 0) await new Promise((done) => setTimeout(done, pause));
      const pose = this._wanted;
      if (pose === null || !this._isHeld) break;
      this._wanted = null;
      this._sentAt = performance.now();
      await this._call(pose, durationOf(pose));
    }
    this._isSending = false;
  }

  _letGo() {
    this._isHeld = false;
    this._wake();
    this._runsUntil = 0;
    running.value = null;
    this._wanted = null;
    targets.value = {};
    if (!isMine.peek()) this._beats.stop();
  }

  /** @param {unknown} error */
  _refused(error) {
    if (error instanceof RequestError) refusal.value = error.message;
    this.end(); // what was moved before does not go on
  }
}

/**
 * Return the seconds in which servos reach a pose at the pace that was chosen.
 * @param {Pose} pose
 */
function durationOf(pose) {
  const ways = Object.entries(pose).map(([id, angle]) =>
    Math.abs(angle - (servos.value.get(Number(id))?.angle ?? angle)),
  );
  return Math.max(SHORTEST, Math.round((Math.max(0, ...ways) / pace.value) * 100) / 100);
}

/**
 * Return whether a servo obeys movements.
 * @param {import("./robot.js").Servo} servo
 */
function isReady(servo) {
  return servo.is_start && servo.is_hold;
}
