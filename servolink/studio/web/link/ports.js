// Ports for the studio in the worker: only a page may open a port, so the page carries the bytes, in the messages that
// `servolink/transports/page_ports.py` lists. STOP does not wait for the worker: the page writes the frame that stops
// all servos, and drops motions of before.

/** @typedef {(kind: string, number: number, text: string) => void} Post */
/** @typedef {{ open: (options: Options) => Promise<void>, read: () => Promise<Uint8Array | null>, write: (piece: Uint8Array, isLast: boolean) => Promise<void>, piece: number, close: () => Promise<void> }} Device */
/** @typedef {{ url: string, baudrate?: number, dtr?: boolean, rts?: boolean }} Options */
/** @typedef {{ data: Uint8Array, epoch: number, moves: boolean }} Frame */
/** @typedef {{ find: (url: string) => Promise<Device | null> }} Finder */

const CHUNK = 4096; // bytes made to text at once
const LOCK = "servolink port"; // held by the one tab with a robot
const [ABSENT, IN_USE, OTHER_TAB] = ["absent", "in use", "other tab"]; // reasons for which the worker has texts

/** All ports that the studio has opened. */
export class Ports {
  /** @param {Post} post posts a message to the worker @param {Finder} finder finds ports that the page may use */
  constructor(post, finder) {
    this._post = post;
    this._finder = finder;
    this._epoch = 0;
    /** @type {Map<number, Port>} */
    this._open = new Map();
    /** Whether the lock is held, until the page ends; null before the first port. @type {Promise<boolean> | null} */
    this._lock = null;
  }

  /** Whether at least one board is connected at present. */
  get isInUse() {
    return this._open.size > 0;
  }

  /** Handle a message of the worker about a port. @param {string} kind @param {number} number @param {string} text */
  hear(kind, number, text) {
    const port = this._open.get(number);
    if (kind === "port.open") this._begin(number, JSON.parse(text));
    else if (kind === "port.stop" && port) port.stopFrame = bytesOf(text);
    else if (kind === "port.frame") port?.send(frameOf(text));
    else if (kind === "port.close") this._end(number);
  }

  /** Stop all servos at once, and drop motions of the worker until the worker takes note of the stop. */
  stop() {
    this._epoch++;
    for (const [number, port] of this._open) {
      if (port.device === null) continue; // opening: later frames carry the new epoch
      port.stop(this._epoch);
      this._post("port.stopped", number, String(this._epoch));
    }
  }

  /** Stop all servos now, and close the ports: the worker has ended. */
  abandon() {
    for (const port of this._open.values()) port.stop(++this._epoch);
    for (const number of [...this._open.keys()]) this._end(number);
  }

  /** Close the ports, whose boards the studio has left; a board that the page has moved is stopped once more. */
  release() {
    for (const port of this._open.values()) if (port.hasMoved) port.stop(++this._epoch);
    for (const number of [...this._open.keys()]) this._end(number);
  }

  /** @param {number} number @param {Options} options */
  async _begin(number, options) {
    const port = new Port((kind, text = "") => this._post(kind, number, text));
    this._open.set(number, port);
    const failure = await this._openPort(port, options);
    if (!failure && this._open.get(number) === port) {
      this._post("port.opened", number, String(this._epoch));
      port.run().then(() => this._lost(number));
      return;
    }
    await port.close();
    if (this._open.get(number) === port) this._open.delete(number);
    this._post(failure ? "port.failed" : "port.closed", number, failure);
  }

  /** Open a port; return the reason of a failure, else an empty text. @param {Port} port @param {Options} options */
  async _openPort(port, options) {
    if (!(await this._takeLock())) return OTHER_TAB;
    try {
      const device = await this._finder.find(options.url);
      if (device === null) return ABSENT;
      await device.open(options);
      port.device = device;
      return "";
    } catch (error) {
      const { name = "", message = String(error) } = /** @type {Error} */ (error);
      return name === "NetworkError" || name === "InvalidStateError" ? IN_USE : message;
    }
  }

  /** Take the lock, for which no other tab opens a port; return whether that is possible. @returns {Promise<boolean>} */
  async _takeLock() {
    this._lock ??= new Promise((resolve) => {
      navigator.locks.request(LOCK, { ifAvailable: true }, (lock) => {
        resolve(lock !== null);
        return lock && new Promise(() => {});
      });
    });
    const isOurs = await this._lock;
    if (!isOurs) this._lock = null;
    return isOurs;
  }

  /** @param {number} number */
  async _end(number) {
    const port = this._open.get(number);
    if (!port) return;
    this._open.delete(number);
    if (port.device === null) return;
    await port.close();
    this._post("port.closed", number, "");
  }

  /** @param {number} number */
  async _lost(number) {
    const port = this._open.get(number);
    if (!port) return;
    this._open.delete(number);
    await port.close();
    this._post("port.lost", number, "");
  }
}

/** Queue of frames for one open port; at most one frame is ahead of a stop in the browser. */
class Port {
  /** @param {(kind: string, text?: string) => void} tell tells the worker */
  constructor(tell) {
    this._tell = tell;
    /** @type {Device | null} */
    this.device = null;
    this.stopFrame = new Uint8Array();
    /** Frames waiting to be given to the browser. @type {Frame[]} */
    this._waiting = [];
    /** Unwritten rest of the frame being written. @type {Uint8Array | null} */
    this._rest = null;
    /** Whether a frame was sent that may move servos. */
    this.hasMoved = false;
    this._sent = 0;
    this._isWriting = false;
    this._least = 0; // oldest epoch whose motions are sent
    /** @type {Promise<void>} */
    this._broken = new Promise((resolve) => (this._break = resolve));
  }

  /** Pass received bytes to the worker until the device is gone. */
  run() {
    return Promise.race([this._read(/** @type {Device} */ (this.device)).catch(() => {}), this._broken]);
  }

  /** @param {Device} device */
  async _read(device) {
    for (let data = await device.read(); data !== null; data = await device.read())
      this._tell("port.data", textOf(data));
  }

  /** @param {Frame} frame */
  send(frame) {
    if (frame.moves && frame.epoch < this._least) return this._count(frame.data.length);
    this.hasMoved ||= frame.moves;
    if (isSame(frame.data, this.stopFrame)) {
      this._dropMotions();
      this._waiting.unshift(frame);
    } else this._waiting.push(frame);
    this._write();
  }

  /** @param {number} epoch */
  stop(epoch) {
    this._least = epoch;
    this._dropMotions();
    // At once: a hidden page may run nothing later. The rest of a frame goes first, or the stop would become part of
    // that frame.
    const rest = this._rest ?? new Uint8Array();
    this._rest = null;
    if (rest.length > 0) this._giveAll(rest).then(() => this._count(rest.length));
    this._giveAll(this.stopFrame);
  }

  async close() {
    this._waiting = [];
    await this.device?.close().catch(() => {});
  }

  _dropMotions() {
    for (const { data } of this._waiting.filter(({ moves }) => moves)) this._count(data.length);
    this._waiting = this._waiting.filter(({ moves }) => !moves);
  }

  async _write() {
    if (this._isWriting) return;
    this._isWriting = true;
    for (let next = this._waiting.shift(); next; next = this._waiting.shift()) {
      for (this._rest = next.data; this._rest?.length;) {
        const piece = this._rest.subarray(0, this._size);
        this._rest = this._rest.subarray(this._size);
        if (!(await this._give(piece, this._rest.length === 0))) return;
        this._count(piece.length);
      }
      this._rest = null;
    }
    this._isWriting = false;
  }

  /** Bytes given to the browser at once. */
  get _size() {
    return this.device?.piece ?? CHUNK;
  }

  /** Give the end of a frame to the browser, without waiting between pieces. @param {Uint8Array} data */
  _giveAll(data) {
    const given = [];
    for (let at = 0; at < data.length; at += this._size)
      given.push(this._give(data.subarray(at, at + this._size), at + this._size >= data.length));
    return Promise.all(given);
  }

  /** Give bytes to the browser, and return whether all were accepted. @param {Uint8Array} piece @param {boolean} isLast */
  async _give(piece, isLast) {
    try {
      await this.device?.write(piece, isLast);
      return true;
    } catch {
      this._break();
      return false;
    }
  }

  /** @param {number} bytes */
  _count(bytes) {
    this._sent += bytes;
    this._tell("port.sent", String(this._sent));
  }
}

/** @param {string} text @returns {Frame} */
function frameOf(text) {
  const at = text.indexOf(" "),
    head = text.slice(0, at);
  return { data: bytesOf(text.slice(at + 1)), epoch: parseInt(head, 10), moves: head.endsWith("!") };
}

/** @param {string} text */
const bytesOf = (text) => Uint8Array.from(text, (character) => character.charCodeAt(0));

/** @param {Uint8Array} data */
function textOf(data) {
  let text = "";
  for (let at = 0; at < data.length; at += CHUNK) text += String.fromCharCode(...data.subarray(at, at + CHUNK));
  return text;
}

/** @param {Uint8Array} one @param {Uint8Array} other */
const isSame = (one, other) => one.length === other.length && one.every((byte, at) => byte === other[at]);
