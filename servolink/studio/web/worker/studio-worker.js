// The studio in a worker: loads Python, starts the studio with a virtual robot, and carries messages between its door and
// the page. `files.json` of the build says how much is loaded.

import { KeptLog, keepFolder, openStores } from "./kept-files.js";

/** @typedef {{ take: (kind: string, line: number, text: string) => void, begin: (address: string) => Promise<void> }} Door */

// Folders of the library: files of the user, and files of the running program.
const KEPT = "/servolink",
  RUNNING = "/running";
const PACKAGES = "/lib/python3.14/site-packages";
const RUNTIME = ["pyodide.asm.wasm", "python_stdlib.zip"];

/** @type {Door | null} */
let door = null;
/** @type {[string, number, string][]} */
const early = [];

addEventListener("message", ({ data }) => {
  const message = /** @type {[string, number, string]} */ (data);
  if (door) door.take(...message);
  else early.push(message);
});

/** @param {string} kind @param {number} line @param {string} text */
const post = (kind, line, text) => postMessage([kind, line, text]);

/** Return the bytes of a file, telling the page how many have come. @param {URL} url @param {(bytes: number) => void} tell */
async function load(url, tell) {
  const response = await fetch(url);
  if (!response.ok || !response.body) throw new Error(`${url.pathname}: ${response.status}`);
  const parts = [];
  const reader = response.body.getReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    parts.push(part.value);
    tell(part.value.length);
  }
  return new Blob(parts).arrayBuffer();
}

async function start() {
  const here = new URL("../python/", import.meta.url);
  const runtime = new URL("runtime/", here);
  const { bytes } = await (await fetch(new URL("files.json", here))).json();
  let loaded = 0;
  /** @param {number} more */
  const tell = (more) => post("progress", 0, JSON.stringify({ loaded: (loaded += more), total: bytes }));
  const [packages] = await Promise.all([
    load(new URL("packages.zip", here), tell),
    ...RUNTIME.map((name) => load(new URL(name, runtime), tell)), // so that the browser has them in its cache
  ]);
  const { loadPyodide } = await import(new URL("pyodide.mjs", runtime).href);
  const python = await loadPyodide({ indexURL: runtime.href, env: { HOME: KEPT, XDG_RUNTIME_DIR: RUNNING } });
  python.FS.mkdirTree(RUNNING, 0o700);
  const fail = (/** @type {unknown} */ error) => post("unkept", 0, String(error));
  try {
    keepFolder(python.FS, KEPT, new KeptLog(await openStores()), fail);
  } catch (error) {
    python.FS.mkdirTree(KEPT, 0o700);
    fail(error);
  }
  python.unpackArchive(packages, "zip", { extractDir: PACKAGES });
  const module = python.pyimport("servolink.studio.worker_door");
  door = /** @type {Door} */ (module.WorkerDoor(post));
  for (const message of early) door.take(...message);
  await door.begin(/** @type {any} */ (globalThis).name); // the name of the worker is the address of the latest board
}

start().catch((error) => post("failed", 0, String(error)));
