// Beats: while the page moves the robot, a beat ten times a second says so to the hub. The hub stops the robot when the
// beats stop. Each beat goes from a worker through the page: a worker alone would beat on while the page is frozen.

/** Beats while it is held. */
export class Beats {
  /** @param {() => void} beat */
  constructor(beat) {
    this._beat = beat;
    this._isOn = false;
    this._worker = new Worker(new URL("./beat-worker.js", import.meta.url), { type: "module" });
    this._worker.onmessage = () => {
      if (this._isOn && !document.hidden) this._beat();
    };
  }

  /** Beat from now on. */
  start() {
    this._isOn = true;
    this._beat();
  }

  /** Beat no longer. */
  stop() {
    this._isOn = false;
  }
}
