// The line to a studio that runs in a worker of this page.

import { tellFailure, tellLoading, tellUnkept } from "../state/loading.js";
import { keptAddress, tellRefusal } from "../state/connecting.js";
import { grantedPorts, onPorts } from "./granted.js";
import { PageLine } from "./page-line.js";
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

/** @type {(() => void)[]} */
const stopping = [];
/** Call `stop` when the page stops the robot, or has lost the studio, as for programs in other workers. @param {() => void} stop */
export const onStop = (stop) => void stopping.push(stop);

/** Stop all servos of boards at the ports of this page at once, whatever the worker is doing; then all that moves them. */
export function stopPorts() {
  ports.stop();
  for (const stop of stopping) stop();
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
  for (const stop of stopping) stop();
  tellFailure(why);
  worker?.terminate();
  worker = null;
  for (const line of lines.values()) line.heard("close", JSON.stringify({ code: 1011, reason: why }));
}

/** One connection of the page to the studio in its worker. */
export class WorkerLine extends PageLine {
  /** @param {"open" | "watch"} first kind of the first message, which gives the role */
  constructor(first = "open") {
    const number = ++lastLine;
    super(first, (kind, text) => worker?.postMessage([kind, number, text]));
    this._number = number;
    lines.set(number, this);
    if (worker === null) {
      worker = start();
      tellPorts();
    }
    queueMicrotask(() => this.onopen?.());
  }

  close() {
    lines.delete(this._number);
    super.close();
  }

  /** @param {string} kind @param {string} text */
  heard(kind, text) {
    if (kind !== "message") lines.delete(this._number);
    super.heard(kind, text);
  }
}
