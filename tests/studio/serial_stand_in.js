// `navigator.serial` with one port, as the specification has it, whose line is a WebSocket of the page's server.

(() => {
  const lost = () => new DOMException("The device has been lost.", "NetworkError");
  let isPlugged = true;
  let isGranted = sessionStorage.getItem("granted") === "yes";

  class Port extends EventTarget {
    readable = null;
    writable = null;
    line = null;
    getInfo = () => ({ usbVendorId: 0x1a86, usbProductId: 0x7523 });

    async open({ baudRate, bufferSize = 255 }) {
      if (this.line) throw new DOMException("The port is already open.", "InvalidStateError");
      if (!baudRate || !bufferSize) throw new TypeError("Invalid options.");
      const line = new WebSocket(`ws://${location.host}/line`);
      line.binaryType = "arraybuffer";
      await new Promise((resolve, reject) => {
        line.onopen = resolve;
        line.onerror = () => reject(new DOMException("Failed to open serial port.", "NetworkError"));
        if (!isPlugged) line.onerror();
      });
      this.line = line;
      this.begin();
      const bytesPerMillisecond = baudRate / 10_000;
      this.writable = new WritableStream({
        start: (controller) => (this.sink = controller),
        write: async (data) => {
          if (!(data instanceof Uint8Array)) throw new TypeError("Not bytes.");
          line.send(data);
          await new Promise((resolve) => setTimeout(resolve, data.length / bytesPerMillisecond));
        },
      });
      line.onmessage = ({ data }) => this.source.enqueue(new Uint8Array(data));
      line.onclose = () => this.line === line && this.vanish();
    }

    begin() {
      this.readable = new ReadableStream({ start: (controller) => (this.source = controller) });
    }

    async setSignals() {
      if (!this.line) throw new DOMException("The port is closed.", "InvalidStateError");
    }

    async close() {
      if (!this.line) throw new DOMException("The port is already closed.", "InvalidStateError");
      if (this.readable?.locked || this.writable?.locked) throw new TypeError("Cannot cancel a locked stream");
      this.line.close();
      this.line = this.readable = this.writable = null;
    }

    vanish() {
      isPlugged = false;
      const { readable, source, sink } = this;
      this.readable = this.writable = null;
      if (readable) source.error(lost());
      sink?.error(lost());
      this.dispatchEvent(new Event("disconnect", { bubbles: true }));
      serial.dispatchEvent(new Event("disconnect"));
    }
  }

  const port = new Port();
  const serial = new EventTarget();
  serial.getPorts = async () => (isGranted && isPlugged ? [port] : []);
  serial.requestPort = async (options = {}) => {
    if (!navigator.userActivation.isActive) throw new DOMException("No user gesture.", "SecurityError");
    if (options.filters) throw new TypeError("Filters hide adapters.");
    if (!isPlugged) throw new DOMException("No port selected by the user.", "NotFoundError");
    isGranted = true;
    sessionStorage.setItem("granted", "yes");
    return port;
  };
  Object.defineProperty(Navigator.prototype, "serial", { get: () => serial, configurable: true });
  window.plugIn = () => {
    isPlugged = true;
    serial.dispatchEvent(new Event("connect"));
  };
})();
