// A connection of the page to a studio that is no server: what `Link` needs of a WebSocket.

export class PageLine {
  /** @param {string} first kind of the first message @param {(kind: string, text: string) => void} post posts a message to the studio */
  constructor(first, post) {
    this._kind = first;
    this._post = post;
    /** @type {number} */
    this.readyState = WebSocket.OPEN;
    /** @type {(() => void) | null} */
    this.onopen = null;
    /** @type {((event: { data: string }) => void) | null} */
    this.onmessage = null;
    /** @type {((event: { code: number, reason: string }) => void) | null} */
    this.onclose = null;
  }

  /** @param {string} text */
  send(text) {
    this._post(this._kind, text);
    this._kind = "message";
  }

  close() {
    this.readyState = WebSocket.CLOSED;
    this._post("close", "");
  }

  /** Handle a message of the studio. @param {string} kind @param {string} text */
  heard(kind, text) {
    if (kind === "message") return this.onmessage?.({ data: text });
    this.readyState = WebSocket.CLOSED;
    this.onclose?.(JSON.parse(text));
  }
}
