// Sending of poses that follow a finger: one after the other, and always the latest.

/** @typedef {import("../figure/figure.js").Pose} Pose */

const PERIOD = 40; // milliseconds from one pose to the next, at least

/** Sends the latest pose. A pose that was not sent when the next pose came is skipped. */
export class LatestPose {
  /** @type {(pose: Pose) => Promise<void>} */
  #send;
  /** @type {Pose | null} */
  #next = null;
  #isSending = false;
  #sentAt = 0; // milliseconds of `performance.now()`

  /** @param {(pose: Pose) => Promise<void>} send */
  constructor(send) {
    this.#send = send;
  }

  /** @param {Pose} pose */
  want(pose) {
    this.#next = { ...this.#next, ...pose };
    if (!this.#isSending) this.#sendAll();
  }

  /** Forget the pose that was not sent yet. */
  drop() {
    this.#next = null;
  }

  async #sendAll() {
    this.#isSending = true;
    while (this.#next !== null) {
      const pause = this.#sentAt + PERIOD - performance.now();
      if (pause > 0) await new Promise((done) => setTimeout(done, pause));
      const pose = this.#next;
      if (pose === null) break; // dropped meanwhile
      this.#next = null;
      this.#sentAt = performance.now();
      await this.#send(pose);
    }
    this.#isSending = false;
  }
}
