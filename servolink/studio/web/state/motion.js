// Motion of the robot by this page: while a control is held, never otherwise. No other module moves anything.

import { effect, signal } from "../html.js";
import { Beats } from "../link/beats.js";
import { RequestError } from "../link/link.js";
import { stopPorts } from "../link/worker-line.js";
import { shortened } from "./lasting.js";
import { LatestPose } from "./latest-pose.js";
import { MotionState } from "./motion-state.js";
import { isMine, linkState, problem, servos, stalled } from "./robot.js";
import { stoppedCount } from "./stopped.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** Movement of a sequence: begin and duration in seconds. @typedef {{ at: number, duration: number, targets: Pose }} Part */

const DEAD_MAN = 0.35; // seconds without a beat after which the hub stops the robot
const SHORTEST = 0.08; // seconds
const LEAST = 0.01; // seconds, as the board counts them
const SAME = 2; // degrees between target and reading of a servo that has arrived
const LATE = 1; // seconds allowed to a stored motion after the stated end

/** Targets of the movement by hand that were sent or are about to be. */
export const targets = signal(/** @type {Pose} */ ({}));
/** Reason why the latest movement was refused, empty if it was not. */
export const refusal = signal("");
/** Stored motion started by the page and still running. */
export const running = signal(/** @type {{ type: "action" | "macro", id: number } | null} */ (null));
/** Speed at which servos follow what is dragged, degrees per second. */
export const pace = signal(120);

/** Moves the robot of one connection. */
export class Motion {
  #link;
  #beats;
  #state = new MotionState();
  #latest = new LatestPose((pose) => this.#follow(pose));
  /** Sequence that is played, or was last. */
  #played = { wake: () => {} };
  /** Time until which a stored motion may turn servos, milliseconds of `performance.now()`. */
  #runsUntil = 0;
  /** Whether the stored motion lasts only as long as a control is held. */
  #isHeldRun = false;
  /** Time at which the latest movement arrives, in the same milliseconds; Infinity until that is known. */
  #arrivesAt = 0;
  /** Request that stops servos; null in all states but `ending` and `waiting`. @type {Promise<void> | null} */
  #braking = null;

  /** @param {Link} link */
  constructor(link) {
    this.#link = link;
    this.#beats = new Beats(() => link.tell("lease.beat"));
    effect(() => {
      if (!isMine.value || linkState.value !== "open") this.#drop(); // somebody took over, or the connection is gone
    });
    link.on("stopped", (notice) => {
      stalled.value = notice.stalled ?? null; // not told by the hub of an earlier version
      this.#drop(); // targets from before a stop are not sent after it
    });
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

  /** State of the movement by hand. */
  get state() {
    return this.#state.now;
  }

  /** Whether a control is held. */
  get isHeld() {
    return this.#state.isHeld;
  }

  /**
   * Begin to hold. Return whether the robot may be moved now.
   * @param {{ force?: boolean }} [options]
   */
  async begin({ force = false } = {}) {
    this.#state.change("pressed");
    refusal.value = "";
    await this.#braking;
    try {
      await this.#link.call("lease.take", { dead_man: DEAD_MAN, force });
    } catch (error) {
      this.#drop();
      this.#refuse(error);
      return false;
    }
    this.#state.change("leased");
    this.#beats.start();
    return this.#state.isHeld; // the control may have been released meanwhile
  }

  /**
   * Move towards a pose while a control is held. A pose that was wanted before and was not sent is forgotten.
   * @param {Pose} pose
   */
  towards(pose) {
    if (!this.#state.isHeld) return;
    targets.value = { ...targets.value, ...pose };
    this.#latest.want(pose);
  }

  /**
   * Play movements one after the other while a control is held. Return whether all were played.
   * @param {Part[]} parts in the order of their times
   * @param {number} seconds that all of them take
   * @param {(seconds: number) => void} [onTime] called with the time of each movement when it is sent
   */
  async play(parts, seconds, onTime = () => {}) {
    const mine = (this.#played = { wake: () => {} });
    let start = performance.now();
    for (const { at, duration, targets: pose } of [...shortened(parts), { at: seconds, duration: 0, targets: {} }]) {
      await this.#until(start + at * 1000, mine);
      if (!this.#state.isHeld || this.#played !== mine) return false;
      start = Math.max(start, performance.now() - at * 1000); // late: each movement gets its full time all the same
      onTime(at);
      if (Object.keys(pose).length > 0) {
        targets.value = { ...targets.value, ...pose };
        await this.#call(pose, Math.max(LEAST, duration));
      }
    }
    const isPlayed = () => this.#state.isHeld && this.#played === mine;
    if (isPlayed()) await this.#until(this.#arrivesAt, mine); // late: the last movement gets its full time
    return isPlayed();
  }

  /** End the hold: servos that still turn stop where they are. */
  end() {
    if (!this.#state.isHeld) return;
    const isStored = this.#isHeldRun && this.isRunning,
      moving = isMine.value && !isStored ? this.#moving() : [];
    const brakes = moving.length > 0 || (isMine.value && isStored);
    this.#state.change(brakes ? "braking" : "released");
    this.#latest.drop();
    this.#played.wake();
    targets.value = {};
    if (isStored) this.#forgetRun();
    if (brakes) this.#brake(isStored ? this.#stopStored() : this.#stopMoving(moving));
  }

  /**
   * Run a stored motion of the board, stopped on leaving the page or the screen. Return whether the motion runs.
   * @param {"action" | "macro"} type
   * @param {number} id
   * @param {number} seconds that it takes
   * @param {boolean} [isHeld] whether `end` stops the motion
   */
  async run(type, id, seconds, isHeld = false) {
    this.#runsUntil = Infinity;
    this.#isHeldRun = isHeld;
    if (!(await this.begin())) {
      this.#runsUntil = 0;
      return false;
    }
    try {
      await this.#link.call("run", { type, id });
    } catch (error) {
      this.#runsUntil = 0;
      this.#refuse(error);
      return false;
    }
    if (isHeld && !this.#state.isHeld) return false; // released meanwhile, and stopped by that
    this.#runsUntil = performance.now() + (seconds + LATE) * 1000;
    const mine = (running.value = { type, id });
    setTimeout(() => running.value === mine && (running.value = null), seconds * 1000);
    return true;
  }

  /** Whether a motion that was started by `run` may still turn servos. */
  get isRunning() {
    return performance.now() < this.#runsUntil;
  }

  /** Stop the motion of `run`, if still running. Return whether a motion was stopped. */
  endRun() {
    if (!this.isRunning) return false;
    this.stop().catch(() => {}); // without a connection, the hub stops the robot
    return true;
  }

  /** End the hold and give the lease back: nobody looks at this page any more. */
  leave() {
    this.end();
    this.endRun();
    if (this.#braking === null) this.#give();
    else this.#braking.then(() => this.#state.isHeld || this.#give());
  }

  #give() {
    if (isMine.value) this.#link.tell("lease.give");
    this.#beats.stop();
  }

  /** Stop all servos at once, whoever moves them. */
  async stop() {
    stopPorts();
    this.#drop();
    await this.#link.call("stop");
  }

  /** Start all servos, each at its present angle. */
  async startAll() {
    await this.#link.call("servo.set", { servo: "all", start: true, hold: true });
  }

  /** Let a program of this page move the robot: start servos that hold and are stopped, and give the lease back. */
  async makeWay() {
    this.leave();
    if (stoppedCount.value > 0) await this.startAll();
    this.#link.tell("lease.give");
  }

  /**
   * Wait until a time of `performance.now()`, or until a sequence is woken because the hold has ended.
   * @param {number} time
   * @param {{ wake: () => void }} sequence
   */
  #until(time, sequence) {
    return new Promise((done) => {
      const timer = setTimeout(done, Math.max(0, time - performance.now()));
      sequence.wake = () => {
        clearTimeout(timer);
        done(undefined);
      };
    });
  }

  /** Move towards a pose; if that takes several movements, the next one follows while nothing else is wanted. @param {Pose} pose */
  async #follow(pose) {
    const [first, next] = shortened([{ at: 0, duration: durationOf(pose), targets: pose }]);
    await this.#call(first.targets, first.duration);
    if (!next) return;
    setTimeout(() => {
      const left = Object.entries(pose).filter(([id, angle]) => targets.value[Number(id)] === angle);
      if (this.#state.isHeld && left.length > 0) this.#latest.want(Object.fromEntries(left));
    }, first.duration * 1000);
  }

  /**
   * @param {Pose} pose
   * @param {number} duration seconds
   */
  async #call(pose, duration) {
    this.#arrivesAt = Infinity;
    try {
      const { seconds } = await this.#link.call("move", { targets: pose, duration });
      this.#arrivesAt = performance.now() + seconds * 1000;
    } catch (error) {
      if (this.#state.isHeld) this.#refuse(error); // a release before it has ended the movement already
    }
  }

  /** Return the servos moved by the page and perhaps still turning: readings alone may be old. */
  #moving() {
    const isOver = performance.now() >= this.#arrivesAt;
    return Object.entries(targets.value).flatMap(([key, target]) => {
      const id = Number(key),
        servo = servos.value.get(id);
      const rests = servo === undefined || !isReady(servo) || (isOver && Math.abs(servo.angle - target) <= SAME);
      return rests ? [] : [id];
    });
  }

  /**
   * Wait until servos are stopped. Of several such requests, the last one ends the state.
   * @param {Promise<void>} stopping
   */
  #brake(stopping) {
    const mine = (this.#braking = stopping.finally(() => {
      if (this.#braking !== mine) return;
      this.#braking = null;
      this.#state.change("braked");
    }));
  }

  /** Stop a stored motion, which only a stop of all servos ends. Servos start again unless one is limp or stopped. */
  async #stopStored() {
    const areReady = [...servos.value.values()].every(isReady);
    try {
      await (areReady ? this.#link.call("move.end", { servos: null }) : this.#link.call("stop"));
    } catch (error) {
      if (error instanceof RequestError) problem.value = error.message; // without a connection, the hub stops the robot
    }
  }

  /** @param {number[]} ids */
  async #stopMoving(ids) {
    const isOneStop = ids.length > 1 && [...servos.value.values()].every(isReady); // then all are the same afterwards
    try {
      await this.#link.call("move.end", { servos: isOneStop ? null : ids });
    } catch (error) {
      if (error instanceof RequestError) problem.value = error.message; // without a connection, the hub stops the robot
    }
  }

  /** Forget all that was wanted: the robot may not be moved any more. */
  #drop() {
    this.#state.change("dropped");
    this.#played.wake();
    this.#forgetRun();
    this.#latest.drop();
    targets.value = {};
    if (!isMine.peek()) this.#beats.stop();
  }

  #forgetRun() {
    this.#runsUntil = 0;
    this.#isHeldRun = false;
    running.value = null;
  }

  /** @param {unknown} error */
  #refuse(error) {
    if (error instanceof RequestError) refusal.value = error.message;
    this.end(); // earlier movements do not go on
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
