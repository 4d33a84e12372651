// The line to a studio that runs in a worker of this page: what `Link` needs of a WebSocket.

import { tellFailure, tellLoading, tellUnkept } from "../state/loading.js";
import { keptAddress, tellRefusal } from "../state/connecting.js";
import { grantedPorts, onPorts } from "./granted.js";
import { Ports } from "./ports.js";

/** @type {Worker | null} */
let worker = null;
let lastLine = 0,
  lastProgram = 0;
/** @type {Map<number, WorkerLine>} */
const lines = new Map();
const ports = new Ports((kind, number, text) => worker?.postMessage([kind, number, text]), {
  find: async (url) => (await grantedPorts()).get(url)?.make() ?? null,
});

/** What ends the programs in other workers. */
let endPrograms = () => {};
/** Call `end` when the page stops the robot, or has lost the studio: its programs are to end then. @param {() => void} end */
export const onStop = (end) => void (endPrograms = end);

/** Stop all servos of boards at the ports of this page at once, whatever the worker is doing; then end the programs. */
export function stopPorts() {
  ports.stop();
  endPrograms();
}

/** Connect a program in another worker with the hub, through a port; return its number. @param {MessagePort} port */
export function joinProgram(port) {
  worker?.postMessage(["program.open", ++lastProgram, ""], [port]);
  return lastProgram;
}

/** Tell the hub that a program has gone. @param {number} number */
export const endProgram = (number) => worker?.postMessage(["program.end", number, ""]);

/** Close the ports ahead of a load of the page with another board, which need not be stopped for that. */
export const releasePorts = () => ports.release();

/** List the ports granted to this page for the worker. */
export async function tellPorts() {
  const found = [...(await grantedPorts())].map(([url, { product }]) => ({ url, product }));
  worker?.postMessage(["port.list", 0, JSON.stringify(found)]);
}

/** Stop servos from now on when nobody looks at the page, and follow the ports that come and go. */
export function watchPorts() {
  // A browser may freeze or end a hidden page without further events.
  /** @type {[EventTarget, string][]} */
  const ends = [
    [document, "visibilitychange"],
    [document, "freeze"],
    [window, "pagehide"],
  ];
  for (const [target, name] of ends)
    target.addEventListener(name, () => {
      if ((name !== "visibilitychange" || document.hidden) && ports.isInUse) stopPorts();
    });
  onPorts(tellPorts);
}

function start() {
  const url = new URL("../worker/studio-worker.js", import.meta.url);
  const started = new Worker(url, { type: "module", name: keptAddress() });
  started.onmessage = ({ data: [kind, number, text] }) => {
    if (kind === "progress") tellLoading(JSON.parse(text));
    else if (kind === "failed") fail(text);
    else if (kind === "unkept") tellUnkept(text);
    else if (kind === "refused") tellRefusal(text);
    else if (kind.startsWith("port.")) ports.hear(kind, number, text);
    else lines.get(number)?.heard(kind, text);
  };
  started.onerror = (event) => fail(event.message);
  return started;
}

/** @param {string} why */
function fail(why) {
  ports.abandon();
  endPrograms();
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
    if (worker === null) {
      worker = start();
      tellPorts();
    }
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
