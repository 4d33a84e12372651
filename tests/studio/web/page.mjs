// Parts of a browser that modules of the page need, steered by tests: WebSocket, worker, window, document and storage.

import { readFileSync } from "node:fs";

/** Each WebSocket that was opened, the newest last. */
export const sockets = [];

class FakeSocket {
  static OPEN = 1;
  static CLOSED = 3;
  sent = [];
  readyState = 0;

  constructor(url) {
    this.url = url;
    sockets.push(this);
  }

  send(text) {
    this.sent.push(JSON.parse(text));
  }

  /** Let the connection open, and the studio welcome the page. */
  welcome(session = "mine", name = "rex", stops = null) {
    this.readyState = FakeSocket.OPEN;
    this.onopen();
    this.hear({
      session,
      role: "edit",
      name,
      url: "virtual://",
      is_virtual: true,
      profile: null,
      stops,
    });
  }

  close() {
    this.readyState = FakeSocket.CLOSED;
  }

  hear(message) {
    this.onmessage({ data: JSON.stringify(message) });
  }

  lose(code = 1006) {
    this.readyState = 3;
    this.onclose({ code });
  }
}

/** Let each worker tick once. */
export const tick = () => workers.forEach((worker) => worker.onmessage?.({ data: 0 }));
const workers = [];

class FakeWorker {
  constructor() {
    workers.push(this);
  }
}

class FakeStorage extends Map {
  getItem(key) {
    return this.get(key) ?? null;
  }

  setItem(key, text) {
    this.set(key, text);
  }

  removeItem(key) {
    this.delete(key);
  }
}

export const localStorage = new FakeStorage();
export const sessionStorage = new FakeStorage();
for (const [name, value] of Object.entries({ localStorage, sessionStorage }))
  Object.defineProperty(globalThis, name, { value, configurable: true });

/** Frames that were requested; `frame` draws the next one. */
let frames = [];

/** Draw one frame, at a time in milliseconds. */
export function frame(now) {
  const requested = frames;
  frames = [];
  for (const draw of requested) draw(now);
}

export const document = Object.assign(new EventTarget(), { hidden: false });
export const window = new EventTarget();
Object.defineProperty(globalThis, "navigator", { value: { languages: ["en-GB"] }, configurable: true });
Object.assign(globalThis, {
  WebSocket: FakeSocket,
  Worker: FakeWorker,
  document,
  window,
  addEventListener: (...args) => window.addEventListener(...args),
  removeEventListener: (...args) => window.removeEventListener(...args),
  requestAnimationFrame: (draw) => frames.push(draw),
});

globalThis.fetch = async (url) => ({ json: async () => JSON.parse(readFileSync(url, "utf8")) });
const { load, texts } = await import("../../../servolink/studio/web/texts/text.js");
texts.value = await load("en");

/** Let everything happen that waits for nothing but its turn. */
export const turns = async () => {
  for (let turn = 0; turn < 20; turn++) await Promise.resolve();
};

/** A connection that keeps what is asked, and answers when a test says so. */
export class FakeLink {
  listeners = new Map(); // the latest of each notification
  asked = [];
  told = [];

  on(name, listener) {
    this.listeners.set(name, listener);
  }

  tell(method) {
    this.told.push(method);
    return true;
  }

  call(method, params, onProgress) {
    return new Promise((resolve, reject) => this.asked.push({ method, params, onProgress, resolve, reject }));
  }

  /** Let the hub or the studio notify the page. */
  hear(name, params) {
    this.listeners.get(name)(params);
  }

  /** Return the oldest request of this method that was not answered, and forget it. */
  taken(method) {
    const at = this.asked.findIndex((each) => each.method === method);
    return at < 0 ? null : this.asked.splice(at, 1)[0];
  }
}

/** Return a project of two actions and two macros, of which the second one runs the first. */
export function projectForm() {
  const step = (servo_id, degree, interval_ms = 500) => ({ servo_id, degree, interval_ms });
  const command = (type, values, total_interval_ms) => ({
    type,
    ...values,
    ratio_percent: 100,
    loop: 1,
    total_interval_ms,
  });
  const button = { button_id: 7, button_caption: "", button_press_macro: 1, button_long_press_macro: 2 };
  return {
    schema: 1,
    project_id: 5,
    servo_parameters: [1, 2].map((servo_id) => ({ servo_id, adjusted_degree: 0, servo_caption: `servo ${servo_id}` })),
    actions: [
      { action_id: 1, action_caption: "up", steps: [step(1, 90), step(2, -30, 1000)] },
      { action_id: 2, action_caption: "down", steps: [step(1, 0)] },
    ],
    macros: [
      {
        macro_id: 1,
        macro_caption: "wave",
        commands: [command("action", { action_id: 1 }, 1000), command("action", { action_id: 2 }, 500)],
      },
      {
        macro_id: 2,
        macro_caption: "twice",
        commands: [command("macro", { macro_id: 1 }, 1500), command("delay", { delay_ms: 200 }, 200)],
      },
    ],
    joystick_tables: [
      { table_id: 1, table_caption: "", buttons: [{ ...button, button_up_macro: 0, uninterruptible: 0 }] },
    ],
    active_joystick_table: 1,
  };
}
