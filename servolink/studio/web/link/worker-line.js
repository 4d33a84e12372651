// The line to a studio that runs in a worker of this page: what `Link` needs of a WebSocket.

import { tellFailure, tellLoading } from "../state/loading.js";

/** @type {Worker | null} */
let worker = null;
let lastLine = 0;
/** @type {Map<number, WorkerLine>} */
const lines = new Map();
function start() {
  const started = new Worker(new URL("../worker/studio-worker.js", import.meta.url), { type: "module" });
  started.onmessage = ({ data: [kind, number, text] }) => {
    if (kind === "progress") tellLoading(JSON.parse(text));
    else if (kind === "failed") fail(text);
    else lines.get(number)?.heard(kind, text);
  };
  started.onerror = (event) => fail(event.message);
  return started;
}

/** @param {string} why */
function fail(why) {
  tellFailure(why);
  worker?.terminate();
  worker = null;
  for (const line of lines.values()) line.heard("close", JSON.stringify({ code: 1011, reason: why }));
}

/** One connection of the page to the studio. */
export class WorkerLine {
  constructor() {
    this._number = ++lastLine;
    /** @type {number} */
    this.readyState = WebSocket.OPEN;
    /** @type {(() => void) | null} */
    this.onopen = null;
    /** @type {((event: { data: string }) => void) | null} */
    this.onmessage = null;
    /** @type {((event: { code: number, reason: string }) => void) | null} */
    this.onclose = null;
    this._kind = "open";
    lines.set(this._number, this);
    worker ??= start();
    queueMicrotask(() => this.onopen?.());
  }

  /** @param {string} text */
  send(text) {
    worker?.postMessage([this._kind, this._number, text]);
    this._kind = "message";
  }

  close() {
    this.readyState = WebSocket.CLOSED;
    lines.delete(this._number);
    worker?.postMessage(["close", this._number, ""]);
  }

  /** @param {string} kind @param {string} text */
  heard(kind, text) {
    if (kind === "message") return this.onmessage?.({ data: text });
    this.readyState = WebSocket.CLOSED;
    lines.delete(this._number);
    this.onclose?.(JSON.parse(text));
  }
}
