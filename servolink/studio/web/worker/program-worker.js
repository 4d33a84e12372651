// A program of a person in a worker of its own: loads Python, waits for the text of the program, and runs it without the
// powers of a page.

import { startPython } from "./python.js";

// All else that a worker has goes: ports of devices, the network, what the browser keeps, and further workers.
const LEFT = new Set(
  `AbortController AbortSignal DOMException Event EventTarget MessageChannel MessageEvent MessagePort TextDecoder
  TextEncoder URL URLSearchParams WebAssembly addEventListener atob btoa clearInterval clearTimeout close console crypto
  location name onmessage performance postMessage queueMicrotask removeEventListener scheduler self setInterval
  setTimeout structuredClone`.split(/\s+/),
);
const LEFT_OF_NAVIGATOR = new Set(["hardwareConcurrency", "language", "languages", "platform", "userAgent"]);

/** Names that JavaScript itself has in any place, and not the browser. */
const isOfLanguage = (/** @type {string} */ name) =>
  /^(Object|Function|Array|Number|Boolean|String|Symbol|BigInt|Math|JSON|Date|RegExp|Promise|Proxy|Reflect|Map|Set|WeakMap|WeakSet|WeakRef|FinalizationRegistry|Iterator|ArrayBuffer|SharedArrayBuffer|Atomics|DataView|\w+Array|\w*Error|Intl|SuppressedError|Suspend\w*|undefined|NaN|Infinity|globalThis|parse(Int|Float)|is(NaN|Finite)|(de|en)codeURI(Component)?|(un)?escape|eval|constructor|__\w+__|hasOwnProperty|isPrototypeOf|propertyIsEnumerable|to(Locale)?String|valueOf)$/.test(
    name,
  );

/** Delete the properties of an object, and of the prototypes that it shares with no other one. @param {any} object @param {(name: string) => boolean} stays */
function strip(object, stays) {
  for (
    let one = object;
    one && one !== Object.prototype && one !== EventTarget.prototype;
    one = Object.getPrototypeOf(one)
  )
    for (const name of Object.getOwnPropertyNames(one)) if (!stays(name)) Reflect.deleteProperty(one, name);
}

function takePowers() {
  strip(navigator, (name) => LEFT_OF_NAVIGATOR.has(name));
  strip(globalThis, (name) => LEFT.has(name) || isOfLanguage(name) || name === "navigator" || name.startsWith("_"));
}

const post = (/** @type {string} */ kind, /** @type {string} */ text) => postMessage([kind, text]);

async function start() {
  /** @type {Promise<[string, MessagePort]>} */
  const asked = new Promise((resolve) => {
    addEventListener("message", ({ data, ports }) => resolve([data, ports[0]]), { once: true });
  });
  const python = await startPython({ HOME: "/home/pyodide", XDG_RUNTIME_DIR: "/running" }, () => {});
  const { ProgramWorker } = python.pyimport("servolink.studio.program_worker");
  python.pyimport("servolink"); // with the names that programs use
  post("ready", "");
  const [text, port] = await asked;
  const program = ProgramWorker(post, (/** @type {any[]} */ ...message) => port.postMessage(message));
  port.onmessage = ({ data }) => program.hear(...data);
  takePowers();
  await program.run(text);
}

start().catch((error) => post("failed", String(error)));
