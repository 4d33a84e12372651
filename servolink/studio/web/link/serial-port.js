// Serial ports of the browser (Web Serial), as `Ports` uses them.

/** @typedef {import("./ports.js").Options} Options */
/** @typedef {{ getInfo: () => { usbVendorId?: number, usbProductId?: number }, readable: ReadableStream<Uint8Array> | null, writable: WritableStream<Uint8Array> | null, open: (options: object) => Promise<void>, close: () => Promise<void>, setSignals: (signals: object) => Promise<void> }} SerialPort */

const BUFFER = 4096; // bytes that the browser holds for reading and for writing
const DRAINS = 300; // milliseconds for written bytes to leave before a port is closed

/** Serial port with the streams of one connection to a board. */
export class SerialDevice {
  /** @param {SerialPort} port */
  constructor(port) {
    this._port = port;
    this.piece = BUFFER;
    /** @type {ReadableStreamDefaultReader<Uint8Array> | null} */
    this._reader = null;
    /** @type {WritableStreamDefaultWriter<Uint8Array> | null} */
    this._writer = null;
  }

  /** @param {Options} options */
  async open({ baudrate = 115200, dtr = false, rts = false }) {
    await this._port.open({ baudRate: baudrate, bufferSize: BUFFER });
    this._writer = /** @type {WritableStream<Uint8Array>} */ (this._port.writable).getWriter();
    this._writer.closed.catch(() => {});
    await this._port.setSignals({ dataTerminalReady: dtr, requestToSend: rts }).catch(() => {}); // some adapters have no such signals
  }

  /** Return the next bytes; null once the port is gone. After a disturbed byte the browser gives a new stream. */
  async read() {
    while (this._port.readable) {
      this._reader ??= this._port.readable.getReader();
      try {
        const { value, done } = await this._reader.read();
        return done ? null : value;
      } catch {
        // a break, a framing error or an overrun, if there is a new stream; otherwise the device is gone
      }
      if (this._reader === null) return null; // by `close` meanwhile
      this._reader.releaseLock();
      this._reader = null;
    }
    return null;
  }

  /** @param {Uint8Array} data */
  write(data) {
    return /** @type {WritableStreamDefaultWriter<Uint8Array>} */ (this._writer).write(data);
  }

  async close() {
    const reader = this._reader,
      writer = this._writer;
    this._reader = this._writer = null;
    if (writer) {
      const left = writer.close().catch(() => {});
      await Promise.race([left, new Promise((resolve) => setTimeout(resolve, DRAINS))]);
      await writer.abort().catch(() => {});
      writer.releaseLock();
    }
    await reader?.cancel().catch(() => {});
    reader?.releaseLock();
    await this._port.close();
  }
}
