// The studio in a worker: loads Python, starts the studio with a virtual robot, and carries messages between its door and
// the page. A program in another worker has a port of its own to the door.

import { KeptLog, keepFolder, openStores } from "./kept-files.js";
import { startPython } from "./python.js";

/** @typedef {(kind: string, number: number, text: string) => void} Post */
/** @typedef {{ take: Post, begin: (address: string) => Promise<void>, join: (program: number, post: Post) => void, hear: (program: number, kind: string, pipe: number, text: string) => void }} Door */

// Folders of the library: files of the user, and files of the running program.
const KEPT = "/servolink",
  RUNNING = "/running";

/** @type {Door | null} */
let door = null;
/** @type {MessageEvent[]} */
const early = [];

/** @param {MessageEvent} event */
function take(event) {
  if (!door) return early.push(event);
  const [kind, number, text] = /** @type {[string, number, string]} */ (event.data);
  if (kind === "program.open") return join(door, number, event.ports[0]);
  return door.take(kind, number, text);
}

/** Connect a program. It may be hostile: other messages than those of the library end here. @param {Door} hub @param {number} program @param {MessagePort} port */
function join(hub, program, port) {
  port.onmessage = ({ data }) => {
    if (!Array.isArray(data)) return;
    const [kind, pipe, text] = data;
    if (typeof kind === "string" && Number.isInteger(pipe) && typeof text === "string")
      hub.hear(program, kind, pipe, text);
  };
  hub.join(program, (kind, pipe, text) => port.postMessage([kind, pipe, text]));
}

/** @type {Post} */
const post = (kind, line, text) => postMessage([kind, line, text]);

async function start() {
  const env = { HOME: KEPT, XDG_RUNTIME_DIR: RUNNING };
  const python = await startPython(env, (now) => post("progress", 0, JSON.stringify(now)));
  const fail = (/** @type {unknown} */ error) => post("unkept", 0, String(error));
  try {
    keepFolder(python.FS, KEPT, new KeptLog(await openStores()), fail);
  } catch (error) {
    python.FS.mkdirTree(KEPT, 0o700);
    fail(error);
  }
  door = /** @type {Door} */ (python.pyimport("servolink.studio.worker_door").WorkerDoor(post));
  for (const event of early) take(event);
  await door.begin(/** @type {any} */ (globalThis).name); // the name of the worker is the address of the latest board
}

addEventListener("message", take);
start().catch((error) => post("failed", 0, String(error)));
