// What the modules of the page need of a browser: a WebSocket, a worker, a window and a document that tests steer.

/** Each WebSocket that was opened, the newest last. */
export const sockets = [];

class FakeSocket {
  static OPEN = 1;
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
  welcome(session = "mine") {
    this.readyState = FakeSocket.OPEN;
    this.onopen();
    this.hear({
      session,
      role: "edit",
      name: "rex",
      url: "virtual://",
      is_virtual: true,
      profile: null,
    });
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

export const document = Object.assign(new EventTarget(), { hidden: false });
export const window = new EventTarget();
Object.assign(globalThis, {
  WebSocket: FakeSocket,
  Worker: FakeWorker,
  document,
  window,
});

/** Let everything happen that waits for nothing but its turn. */
export const turns = async () => {
  for (let turn = 0; turn < 20; turn++) await Promise.resolve();
};

/** A connection that keeps what is asked, and answers when a test says so. */
export class FakeLink {
  listeners = new Map();
  asked = [];
  told = [];

  on(name, listener) {
    this.listeners.set(name, listener);
  }

  tell(method) {
    this.told.push(method);
    return true;
  }

  call(method, params) {
    return new Promise((resolve, reject) => this.asked.push({ method, params, resolve, reject }));
  }

  /** Return the oldest request of this method that was not answered, and forget it. */
  taken(method) {
    const at = this.asked.findIndex((each) => each.method === method);
    return at < 0 ? null : this.asked.splice(at, 1)[0];
  }
}
