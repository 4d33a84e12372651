// Boards on a pair of USB bulk endpoints (WebUSB), as `Ports` uses them.

/** @typedef {{ endpointNumber: number, direction: "in" | "out", type: string, packetSize: number }} Endpoint */
/** @typedef {{ alternateSetting: number, interfaceClass: number, endpoints: Endpoint[] }} Alternate */
/** @typedef {{ interfaceNumber: number, alternates: Alternate[] }} Interface */
/** @typedef {{ interfaces: Interface[] }} Configuration */
/** @typedef {{ vendorId: number, productId: number, productName?: string, configuration: Configuration | null, open: () => Promise<void>, close: () => Promise<void>, selectConfiguration: (value: number) => Promise<void>, claimInterface: (number: number) => Promise<void>, selectAlternateInterface: (number: number, setting: number) => Promise<void>, transferIn: (endpoint: number, length: number) => Promise<{ data?: DataView, status: string }>, transferOut: (endpoint: number, data: Uint8Array) => Promise<{ status: string }>, clearHalt: (direction: string, endpoint: number) => Promise<void> }} UsbDevice */

const VENDOR = 0xff; // class of interfaces whose meaning the maker decides
const PACKETS = 64; // packets of one transfer
const HALTS = 10; // most halts in a row: more are no mere disturbance

/** Board on an interface with a pair of bulk endpoints, for one connection. */
export class BulkPort {
  /** @param {UsbDevice} device */
  constructor(device) {
    this._device = device;
    this._incoming = this._outgoing = /** @type {Endpoint} */ ({});
    this.piece = 4096;
  }

  async open() {
    const device = this._device;
    await device.open();
    if (device.configuration === null) await device.selectConfiguration(1);
    const found = pairOf(/** @type {Configuration} */ (/** @type {unknown} */ (device.configuration)));
    if (found === null) throw new Error("the device has no vendor interface with a pair of bulk endpoints");
    const { number, setting, incoming, outgoing } = found;
    await device.claimInterface(number);
    if (setting !== 0) await device.selectAlternateInterface(number, setting);
    Object.assign(this, { _incoming: incoming, _outgoing: outgoing, piece: PACKETS * outgoing.packetSize });
  }

  /** Return the next bytes; null once the device is gone. */
  async read() {
    const { endpointNumber, packetSize } = this._incoming;
    for (let halts = 0; halts < HALTS; halts++) {
      const { data, status } = await this._device.transferIn(endpointNumber, PACKETS * packetSize);
      if (status === "stall") await this._device.clearHalt("in", endpointNumber);
      else if (data) return new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    }
    return null;
  }

  /** @param {Uint8Array} piece @param {boolean} isLast */
  async write(piece, isLast) {
    const { endpointNumber, packetSize } = this._outgoing;
    const sending = [this._device.transferOut(endpointNumber, piece)];
    // An empty packet marks the end of a frame whose last packet is full.
    if (isLast && piece.length % packetSize === 0)
      sending.push(this._device.transferOut(endpointNumber, new Uint8Array()));
    const [{ status }] = await Promise.all(sending);
    if (status === "stall") await this._device.clearHalt("out", endpointNumber); // the frame is lost, not repeated
  }

  close() {
    return this._device.close();
  }
}

/**
 * Return the first interface of the maker with a pair of bulk endpoints; null without one.
 * @param {Configuration} configuration
 */
function pairOf({ interfaces }) {
  for (const { interfaceNumber: number, alternates } of interfaces)
    for (const { alternateSetting: setting, interfaceClass, endpoints } of alternates) {
      const bulk = endpoints.filter(({ type }) => type === "bulk");
      const incoming = bulk.find(({ direction }) => direction === "in"),
        outgoing = bulk.find(({ direction }) => direction === "out");
      if (interfaceClass === VENDOR && incoming && outgoing) return { number, setting, incoming, outgoing };
    }
  return null;
}
