// Servos released for posing by hand. Released servos are held again, where they are, before anything else happens:
// when the screen or the page is left, when somebody stops the robot, and when another program gets the lease.

import { effect, signal } from "../html.js";
import { Beats } from "../link/beats.js";
import { isLive, isMine, lease, readAt, servos } from "./robot.js";

/** @typedef {import("../link/link.js").Link} Link */

// Limp servos do not move, so a slow page does no harm; but a page silent for so long is gone, and the hub's stop holds
// the released servos.
const DEAD_MAN = 3; // seconds
const RENEW = 3000; // milliseconds: the hub ends a lease under which nothing moves after 10 s
const AGAIN = 1000; // milliseconds after which holding is tried again
const SETTLED = 300; // milliseconds until readings show the sent commands

/** Servos that were released here and are not held again, and whether each was started before. */
export const released = signal(/** @type {ReadonlyMap<number, boolean>} */ (new Map()));
/** Reason why released servos could not be held again, empty if there is none. */
export const failure = signal("");

/** Releases servos, and holds them. */
export class Limp {
  /**
   * @param {Link} link
   * @param {() => void} onHeld called when servos were held although nobody here asked for that
   */
  constructor(link, onHeld) {
    this._link = link;
    this._onHeld = onHeld;
    this._beats = new Beats(() => link.tell("lease.beat"));
    /** @type {Promise<void> | null} */
    this._holding = null;
    this._releasedAt = Infinity; // milliseconds of `performance.now()`
    this._timer = 0;
    effect(() => {
      if (!isMine.value) this._beats.stop();
      if (released.value.size > 0 && !(isMine.value && isLive.value)) this._lost();
    });
    effect(() => this._compare());
    this._listen();
  }

  /**
   * Release servos, which go limp. Rejects after a failure, with all servos held again.
   * @param {number[]} ids
   */
  async release(ids) {
    lease.value = (await this._link.call("lease.take", { dead_man: DEAD_MAN })).lease;
    this._beats.start();
    this._releasedAt = Infinity;
    released.value = new Map(ids.map((id) => [id, servos.value.get(id)?.is_start ?? false]));
    // All at once: what waits in the hub when somebody stops the robot is not sent any more.
    const done = await Promise.allSettled(ids.map((servo) => this._set(servo, false, false)));
    const refused = done.find((one) => one.status === "rejected");
    if (refused) await this.hold({ start: false });
    if (refused) throw refused.reason;
    if (released.peek().size === 0 || this._holding !== null) return;
    this._releasedAt = performance.now();
    this._timer = setInterval(() => this._renew(), RENEW);
  }

  /**
   * Hold the released servos at their angles, then start the servos started before: a servo that is started
   * while limp may turn to its last target.
   * @param {{ start?: boolean }} [options]
   */
  async hold({ start = true } = {}) {
    this._holding ??= this._hold(start).finally(() => (this._holding = null));
    await this._holding;
  }

  /** @param {boolean} start */
  async _hold(start) {
    clearInterval(this._timer);
    const limp = [...released.peek()];
    if (limp.length === 0) return;
    try {
      await Promise.all(limp.map(([servo]) => this._set(servo, false, true)));
    } catch (error) {
      failure.value = error instanceof Error ? error.message : String(error);
      setTimeout(() => this._lost(), AGAIN);
      return;
    }
    this._forget();
    if (!start || !isMine.peek()) return;
    const started = limp.filter(([, wasStarted]) => wasStarted);
    await Promise.allSettled(started.map(([servo]) => this._set(servo, true, true)));
  }

  /**
   * @param {number} servo
   * @param {boolean} start
   * @param {boolean} hold
   */
  _set(servo, start, hold) {
    return this._link.call("servo.set", { servo, start, hold });
  }

  _forget() {
    clearInterval(this._timer);
    this._releasedAt = Infinity;
    failure.value = "";
    released.value = new Map();
  }

  /** Hold the released servos because they may not stay limp. */
  async _lost() {
    if (this._holding !== null || released.peek().size === 0) return;
    await this.hold({ start: false });
    if (released.peek().size === 0) this._onHeld();
  }

  /** Forget the released servos if somebody else has held them: everybody may stop the robot. */
  _compare() {
    if (released.value.size === 0 || readAt.value < this._releasedAt + SETTLED) return;
    if ([...released.peek().keys()].every((id) => servos.peek().get(id)?.is_hold)) this._forget();
  }

  _renew() {
    this._link.call("lease.take", { dead_man: DEAD_MAN }).catch(() => {}); // a notification names the new owner
  }

  /** Hold the released servos when the page is left; before `Motion`, which then gives the lease back. */
  _listen() {
    const leave = () => this._lost();
    // Capturing comes before Motion, but also gets the events of elements.
    window.addEventListener("blur", (event) => event.target === window && leave(), { capture: true });
    window.addEventListener("pagehide", () => released.peek().size > 0 && this._link.tell("stop"), { capture: true });
    document.addEventListener("visibilitychange", () => document.hidden && leave(), { capture: true });
  }
}
