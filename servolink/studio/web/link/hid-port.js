// Boards on an HID interface (WebHID), as `Ports` uses them: a stream of bytes in reports of one size.

/** @typedef {{ reportId: number, items: { reportSize: number, reportCount: number }[] }} Report */
/** @typedef {{ usagePage: number, inputReports: Report[], outputReports: Report[] }} Collection */
/** @typedef {EventTarget & { vendorId: number, productId: number, productName: string, collections: Collection[], open: () => Promise<void>, close: () => Promise<void>, sendReport: (id: number, data: Uint8Array) => Promise<void> }} HidDevice */

const VENDOR_PAGES = 0xff00; // first usage page whose meaning the maker decides
const USUAL_SIZE = 64; // bytes

/** Board on an HID interface, for one connection. */
export class HidPort {
  /** @param {HidDevice} device */
  constructor(device) {
    const own = device.collections.find(({ usagePage }) => usagePage >= VENDOR_PAGES) ?? device.collections[0];
    this._device = device;
    this._incoming = own?.inputReports[0]?.reportId ?? 0;
    this._outgoing = own?.outputReports[0]?.reportId ?? 0;
    this.piece = sizeOf(own?.outputReports[0]) || USUAL_SIZE;
    /** Reports not read yet; null for the end. @type {(Uint8Array | null)[]} */
    this._heard = [];
    this._wake = () => {};
  }

  async open() {
    this._device.addEventListener("inputreport", this);
    hidOf()?.addEventListener("disconnect", this);
    await this._device.open();
  }

  /** Handle a report, or the end of a device. @param {any} event */
  handleEvent({ type, device, reportId, data }) {
    if (device !== this._device) return;
    if (type === "disconnect") this._heard.push(null);
    else if (reportId === this._incoming)
      this._heard.push(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    this._wake();
  }

  /** Return the next bytes; null once the device is gone. */
  async read() {
    while (this._heard.length === 0) await new Promise((resolve) => (this._wake = () => resolve(undefined)));
    return /** @type {Uint8Array | null} */ (this._heard.shift());
  }

  /** @param {Uint8Array} piece */
  write(piece) {
    const report = new Uint8Array(this.piece);
    report.set(piece);
    return this._device.sendReport(this._outgoing, report);
  }

  close() {
    this._device.removeEventListener("inputreport", this);
    hidOf()?.removeEventListener("disconnect", this);
    this._heard.push(null);
    this._wake();
    return this._device.close();
  }
}

/** Return the HID devices of the browser; undefined for a browser without WebHID. */
const hidOf = () => /** @type {{ hid?: EventTarget }} */ (navigator).hid;

/** Return the bytes of a report, without its id. @param {Report | undefined} report */
const sizeOf = (report) =>
  Math.ceil(
    (report?.items ?? []).reduce((bits, { reportSize, reportCount }) => bits + reportSize * reportCount, 0) / 8,
  );
