// Programs of a person: each in a worker of its own, which ends with it. The worker of the next one starts meanwhile.

import { endProgram, joinProgram } from "./worker-line.js";

/** @typedef {{ kind: string, line: number, message: string, trace: string }} Failure */
/** How a program ended. @typedef {"done" | "failed" | "stopped" | "flood" | "broken"} End */
/** @typedef {{ onReady: (isReady: boolean) => void, onOutput: (text: string) => void, onEnd: (end: End, failure: Failure | null) => void }} Listener */

const SECOND = 1000,
  MOST_MESSAGES = 100; // in a second; the library sends 20, more are those of a hostile program

/** The program that runs, and the worker that waits for the next one. */
export class Programs {
  /** @param {Listener} listener */
  constructor(listener) {
    this._listener = listener;
    /** @type {Worker | null} */
    this._spare = null;
    this._isReady = false;
    /** @type {{ worker: Worker, number: number } | null} */
    this._running = null;
  }

  /** Start the worker of the next program, unless one waits. */
  prepare() {
    if (this._spare) return;
    const url = new URL("../worker/program-worker.js", import.meta.url);
    const worker = (this._spare = new Worker(url, { type: "module" }));
    let begun = 0,
      count = 0;
    worker.onmessage = ({ data }) => {
      const now = performance.now();
      if (now - begun > SECOND) [begun, count] = [now, 0];
      if (++count > MOST_MESSAGES) this._ended(worker, "flood");
      else if (Array.isArray(data)) this._hear(worker, String(data[0]), String(data[1]));
    };
    worker.onerror = ({ message }) => this._ended(worker, "broken", message);
  }

  /** Run the text of a program, in place of one that runs. @param {string} text */
  run(text) {
    this.stop();
    if (!this._spare || !this._isReady) return;
    const { port1, port2 } = new MessageChannel();
    this._running = { worker: this._spare, number: joinProgram(port1) };
    this._spare.postMessage(text, [port2]);
    this._forget();
    this.prepare();
  }

  /** End the program that runs. */
  stop() {
    if (this._running) this._ended(this._running.worker, "stopped");
  }

  /** @param {Worker} worker @param {string} kind @param {string} text */
  _hear(worker, kind, text) {
    const isRunning = worker === this._running?.worker;
    if (kind === "ready" && worker === this._spare) this._listener.onReady((this._isReady = true));
    else if (kind === "failed") this._ended(worker, "broken", text);
    else if (kind === "output" && isRunning) this._listener.onOutput(text);
    else if (kind === "ended" && isRunning) this._ended(worker, text ? "failed" : "done", text);
  }

  /** @param {Worker} worker @param {End} end */
  _ended(worker, end, text = "") {
    worker.terminate();
    worker.onmessage = worker.onerror = null;
    if (worker === this._spare) this._forget();
    if (worker !== this._running?.worker) return;
    endProgram(this._running.number);
    this._running = null;
    this._listener.onEnd(end, end === "failed" || end === "broken" ? failureIn(text) : null);
  }

  _forget() {
    this._spare = null;
    this._listener.onReady((this._isReady = false));
  }
}

/** Return the error in a message, which a hostile program may have made up. @param {string} text @returns {Failure} */
function failureIn(text) {
  try {
    const { kind, line, message, trace } = JSON.parse(text);
    return { kind: String(kind), line: Number(line) || 0, message: String(message), trace: String(trace) };
  } catch {
    return { kind: "broken", line: 0, message: "", trace: text };
  }
}
