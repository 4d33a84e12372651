// The connection to the studio: JSON-RPC 2.0 over a WebSocket that is opened again whenever it is lost.

import { said } from "../texts/said.js";
import { t } from "../texts/text.js";

/** @typedef {"connecting" | "open" | "refused" | "lost" | "unshared"} LinkState */
/** @typedef {{ code: number, message: string, data?: { kind?: string, remedy?: string } }} ErrorObject */
/** @typedef {{ session: string, role: "watch" | "run" | "move" | "edit", name: string, url: string, is_virtual: boolean, profile: any, is_link: boolean, has_fleet: boolean, stops: number | null }} Welcome */

/** @typedef {import("./page-line.js").PageLine | WebSocket} Line */

const FIRST_PAUSE = 250,
  LONGEST_PAUSE = 4000; // milliseconds
const BAD_TOKEN = 4401,
  NO_HUB = 4404,
  MOVING = 4410; // codes with which the studio closes the connection

/** A request was answered with an error. */
export class RequestError extends Error {
  /** @param {ErrorObject} error */
  constructor(error) {
    super(said(error.message));
    this.code = error.code;
    this.kind = error.data?.kind ?? "";
    this.remedy = said(error.data?.remedy ?? "");
  }
}

/** The connection was lost before a response came: what was asked for may have happened or not. */
export class LinkLost extends Error {
  constructor() {
    super(t("board.studio_lost"));
  }
}

/** Connection of the page to a single board, until the page is closed: no other board ever gets a message. */
export class Link {
  /**
   * @param {() => Line} connect opens a line to the studio
   * @param {string} token
   * @param {string} who
   */
  constructor(connect, token, who) {
    this._connect = connect;
    this._token = token;
    this._who = who;
    /** @type {Line | null} */
    this._socket = null;
    /** @type {Map<number, { resolve: (result: any) => void, reject: (error: Error) => void, onProgress?: (progress: any) => void }>} */
    this._waiting = new Map();
    /** @type {Map<string, (params: any) => void>} */
    this._listeners = new Map();
    this._lastId = 0;
    this._pause = FIRST_PAUSE;
    this._timer = 0;
    this._leaves = false;
    /** Name of the board; null before the first connection. @type {string | null} */
    this._board = null;
    this._isGreeted = false;
    /** @type {(state: LinkState) => void} */
    this.onState = () => {};
    /** Called with the first message, each time that the connection is open. @type {(welcome: Welcome) => void} */
    this.onWelcome = () => {};
    /** Called with the names of the boards before and after a change, which ends the connection, and the new address. @type {(left: string, next: string, url: string) => void} */
    this.onMoved = () => {};
  }

  /** Connect, and connect again after each loss. */
  open() {
    const socket = (this._socket = this._connect());
    this._isGreeted = false;
    socket.onopen = () =>
      socket.send(JSON.stringify({ token: this._token, who: this._who, leaves: this._leaves || undefined }));
    socket.onmessage = (/** @type {{ data: string }} */ event) => {
      const message = JSON.parse(event.data);
      if (this._isGreeted) return this._take(message);
      this._leaves = false;
      if (this._board !== null && message.name !== this._board) return this._end(message);
      this._board = message.name;
      this._isGreeted = true;
      this._pause = FIRST_PAUSE;
      this._hearStop(message.stops);
      this.onState("open");
      this.onWelcome(message);
    };
    socket.onclose = (/** @type {{ code: number }} */ event) => this._lost(event);
  }

  /** Let the studio leave its board, whose hub has ended, with the next connection, which is tried at once. */
  leave() {
    this._leaves = true;
    if (this._socket?.readyState !== WebSocket.CLOSED) return;
    clearTimeout(this._timer);
    this.open();
  }

  /**
   * Change the name of this page for people at other pages, now and with each new connection.
   * @param {string} who
   */
  rename(who) {
    this._who = who;
    this.tell("studio.rename", { who });
  }

  /**
   * Call a method and return its result. Rejects with RequestError or LinkLost.
   * @param {string} method
   * @param {object} [params]
   * @param {(progress: any) => void} [onProgress] called with each step of a long one
   * @returns {Promise<any>}
   */
  call(method, params = {}, onProgress) {
    return new Promise((resolve, reject) => {
      const id = ++this._lastId;
      if (!this._send({ jsonrpc: "2.0", method, params, id })) return reject(new LinkLost());
      this._waiting.set(id, { resolve, reject, onProgress });
    });
  }

  /**
   * Call a method without waiting for a result. Return whether it was sent.
   * @param {string} method
   * @param {object} [params]
   */
  tell(method, params = {}) {
    return this._send({ jsonrpc: "2.0", method, params });
  }

  /**
   * Call `listener` with the params of each notification of this name.
   * @param {string} name
   * @param {(params: any) => void} listener
   */
  on(name, listener) {
    this._listeners.set(name, listener);
  }

  /** @param {object} message */
  _send(message) {
    if (!this._isGreeted || this._socket?.readyState !== WebSocket.OPEN) return false; // not before the board is known
    this._socket.send(JSON.stringify(message));
    return true;
  }

  /** @param {any} message */
  _take(message) {
    if (message.method === "progress") return this._waiting.get(message.params.id)?.onProgress?.(message.params);
    if (message.method !== undefined) {
      this._listeners.get(message.method)?.(message.params);
      if (message.method === "stopped") this._hearStop(message.params.number);
      return;
    }
    const waiting = this._waiting.get(message.id);
    this._waiting.delete(message.id);
    if (message.error) waiting?.reject(new RequestError(message.error));
    else waiting?.resolve(message.result);
  }

  /**
   * Acknowledge a stop: what was sent before moves nothing, what is sent from now on is of after it.
   * @param {number | null | undefined} number of the stop; none from an earlier hub
   */
  _hearStop(number) {
    if (typeof number === "number") this.tell("stop.heard", { number });
  }

  /** @param {Welcome} next first message of the studio with the new board */
  _end(next) {
    const socket = /** @type {Line} */ (this._socket);
    socket.onmessage = socket.onclose = null;
    socket.close();
    this.onMoved(/** @type {string} */ (this._board), next.name, next.url);
  }

  /** @param {{ code: number }} event */
  _lost(event) {
    this._isGreeted = false;
    const waiting = [...this._waiting.values()];
    this._waiting.clear();
    for (const each of waiting) each.reject(new LinkLost());
    if (event.code === BAD_TOKEN) return this.onState("refused");
    if (event.code === MOVING) return this.open(); // the studio goes on to another board
    this.onState(event.code === NO_HUB ? "unshared" : "lost");
    this._timer = setTimeout(() => this.open(), this._pause);
    this._pause = Math.min(LONGEST_PAUSE, this._pause * 2);
  }
}
