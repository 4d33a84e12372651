// Serial ports of the browser (Web Serial), as `Ports` uses them.

/** @typedef {import("./ports.js").Options} Options */
/** @typedef {{ getInfo: () => { usbVendorId?: number, usbProductId?: number }, readable: ReadableStream<Uint8Array> | null, writable: WritableStream<Uint8Array> | null, open: (options: object) => Promise<void>, close: () => Promise<void>, setSignals: (signals: object) => Promise<void> }} SerialPort */
/** @typedef {EventTarget & { getPorts: () => Promise<SerialPort[]>, requestPort: () => Promise<SerialPort> }} Serial */

const BUFFER = 4096; // bytes that the browser holds for reading and for writing
const DRAINS = 300; // milliseconds for written bytes to leave before a port is closed

/** Names of makers of adapters, by vendor id: the browser gives none. @type {Record<number, string>} */
const MAKERS = {
  0x0403: "FTDI",
  0x067b: "Prolific",
  0x10c4: "Silicon Labs CP210x",
  0x1a86: "CH340",
  0x2341: "Arduino",
  0x2e8a: "Raspberry Pi Pico",
  0x303a: "Espressif",
  0x0483: "STM32",
};

/** Return the serial ports of the browser; null for a browser without Web Serial. */
export const serial = () => /** @type {{ navigator?: { serial?: Serial } }} */ (globalThis).navigator?.serial ?? null;

/** Return the ports that were granted to this page, by address. @returns {Promise<Map<string, SerialPort>>} */
export async function grantedPorts() {
  const found = new Map();
  for (const port of (await serial()?.getPorts()) ?? []) {
    const place = placeOf(port);
    let url = place;
    for (let number = 2; found.has(url); number++) url = `${place}/${number}`;
    found.set(url, port);
  }
  return found;
}

/**
 * Let a person choose a port in the list of the browser, without filters, which would hide adapters; return its address,
 * null for none.
 * @returns {Promise<string | null>}
 */
export async function choosePort() {
  try {
    const chosen = await serial()?.requestPort();
    return [...(await grantedPorts())].find(([, port]) => port === chosen)?.[0] ?? null;
  } catch {
    return null; // the person has closed the list without a choice
  }
}

/** Return the name of a port for people, empty without USB. @param {SerialPort} port */
export function nameOf(port) {
  const { usbVendorId, usbProductId } = port.getInfo();
  if (usbVendorId === undefined) return "";
  return `${MAKERS[usbVendorId] ?? "USB"} (${hex(usbVendorId)}:${hex(usbProductId)})`;
}

/** @param {SerialPort} port */
function placeOf(port) {
  const { usbVendorId, usbProductId } = port.getInfo();
  return `webserial://${hex(usbVendorId)}:${hex(usbProductId)}`;
}

const hex = (number = 0) => number.toString(16).padStart(4, "0");

/** Serial port with the streams of one connection to a board. */
export class SerialDevice {
  /** @param {SerialPort} port */
  constructor(port) {
    this._port = port;
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
