// A file of a browser that a worker can write without waiting.

/** A file of the browser, in which only `room` more bytes can be written in all. */
export class Store {
  /** @param {{ left: number }} room */
  constructor(room, bytes = new Uint8Array()) {
    this.room = room;
    this.bytes = bytes;
  }
  getSize = () => this.bytes.length;
  truncate = (/** @type {number} */ size) => (this.bytes = this.bytes.slice(0, size));
  flush() {}

  /** @param {Uint8Array} to @param {{ at: number }} where */
  read(to, { at }) {
    to.set(this.bytes.subarray(at, at + to.length));
    return to.length;
  }

  /** @param {Uint8Array} from @param {{ at: number }} where */
  write(from, { at }) {
    const part = from.subarray(0, this.room.left);
    const bytes = new Uint8Array(Math.max(this.bytes.length, at + part.length));
    bytes.set(this.bytes);
    bytes.set(part, at);
    this.bytes = bytes;
    this.room.left -= part.length;
    if (part.length < from.length) throw new Error("the tab has ended");
    return part.length;
  }
}
