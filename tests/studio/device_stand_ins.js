// `navigator.usb` and `navigator.hid` with one device each, as the specifications have them, whose line is a WebSocket of
// the page's server.

(() => {
  const granted = (name) => sessionStorage.getItem(`granted ${name}`) === "yes";
  const state = (text) => new DOMException(text, "InvalidStateError");

  /** Line to the board, for one opening of a device. */
  async function lineOf(onData, onEnd) {
    const line = new WebSocket(`ws://${location.host}/line`);
    line.binaryType = "arraybuffer";
    await new Promise((resolve, reject) => {
      line.onopen = resolve;
      line.onerror = () => reject(new DOMException("Access denied.", "NetworkError"));
    });
    line.onmessage = ({ data }) => onData(new Uint8Array(data));
    line.onclose = onEnd;
    return line;
  }

  /** Place of `navigator` with one device, which a person has granted after `requestDevice`. */
  function offer(name, device, answer) {
    const place = Object.assign(new EventTarget(), {
      getDevices: async () => (granted(name) && device.isPlugged ? [device] : []),
      requestDevice: async ({ filters }) => {
        if (!navigator.userActivation.isActive) throw new DOMException("No user gesture.", "SecurityError");
        if (filters.length > 0) throw new TypeError("Filters hide devices.");
        sessionStorage.setItem(`granted ${name}`, "yes");
        return answer(device);
      },
    });
    device.place = place;
    Object.defineProperty(Navigator.prototype, name, { get: () => place, configurable: true });
  }

  const ids = { vendorId: 0x1209, productId: 0x0001, productName: "Test board", isPlugged: true };
  const gone = (device) => {
    device.isPlugged = false;
    device.place.dispatchEvent(Object.assign(new Event("disconnect"), { device }));
  };

  const bulk = (endpointNumber, direction) => ({ endpointNumber, direction, type: "bulk", packetSize: 64 });
  const usb = {
    ...ids,
    configuration: null,
    isClaimed: false,
    heard: [],
    wake: null,
    async open() {
      this.heard = [];
      this.line = await lineOf(
        (data) => (this.heard.push(data), this.wake?.()),
        () => {
          if (this.line === null) return;
          gone(this);
          this.wake?.();
        },
      );
    },
    async selectConfiguration() {
      if (!this.line) throw state("The device must be opened first.");
      const alternate = { alternateSetting: 0, interfaceClass: 0xff, endpoints: [bulk(1, "in"), bulk(2, "out")] };
      this.configuration = { interfaces: [{ interfaceNumber: 0, alternates: [alternate] }] };
    },
    async claimInterface() {
      if (this.configuration === null) throw state("The device is not configured.");
      this.isClaimed = true;
    },
    async transferIn(endpoint) {
      if (!this.isClaimed || endpoint !== 1) throw new DOMException("No such endpoint.", "NotFoundError");
      while (this.heard.length === 0) {
        if (!this.isPlugged || !this.line) throw new DOMException("The device was disconnected.", "NetworkError");
        await new Promise((resolve) => (this.wake = resolve));
      }
      return { status: "ok", data: new DataView(this.heard.shift().buffer) };
    },
    async transferOut(endpoint, data) {
      if (!this.isClaimed || endpoint !== 2) throw new DOMException("No such endpoint.", "NotFoundError");
      if (data.length > 0) this.line.send(data);
      return { status: "ok", bytesWritten: data.length };
    },
    async close() {
      const { line } = this;
      this.line = this.configuration = null;
      this.isClaimed = false;
      line?.close();
      this.wake?.();
    },
  };
  offer("usb", usb, (device) => device);

  const SIZE = 64;
  const report = { reportId: 0, items: [{ reportSize: 8, reportCount: SIZE }] };
  const hid = Object.assign(new EventTarget(), {
    ...ids,
    collections: [{ usagePage: 0xff00, inputReports: [report], outputReports: [report] }],
    async open() {
      if (this.line) throw state("The device is already open.");
      this.line = await lineOf(
        (data) => {
          for (let at = 0; at < data.length; at += SIZE) {
            const padded = new Uint8Array(SIZE);
            padded.set(data.subarray(at, at + SIZE));
            const event = Object.assign(new Event("inputreport"), { device: this, reportId: 0 });
            this.dispatchEvent(Object.assign(event, { data: new DataView(padded.buffer) }));
          }
        },
        () => this.line && gone(this),
      );
    },
    async sendReport(id, data) {
      if (!this.line) throw state("The device must be opened first.");
      if (id !== 0 || data.length !== SIZE) throw new DOMException("Failed to write the report.", "NotAllowedError");
      this.line.send(data);
    },
    async close() {
      const { line } = this;
      this.line = null;
      line?.close();
    },
  });
  offer("hid", hid, (device) => [device]);
})();
