// Ports of the page: STOP without the worker, frames of epochs, and a serial port as the specification has it.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

const { Ports } = await import("../../../servolink/studio/web/link/ports.js");
const { BulkPort } = await import("../../../servolink/studio/web/link/usb-port.js");
const { HidPort } = await import("../../../servolink/studio/web/link/hid-port.js");
const { SerialDevice } = await import("../../../servolink/studio/web/link/serial-port.js");

let isLocked = false;
Object.defineProperty(globalThis, "navigator", {
  configurable: true,
  value: { hid: new EventTarget(), locks: { request: (_name, _options, use) => use(isLocked ? null : {}) } },
});

const STOP = "STOP";
const turn = () => new Promise((resolve) => setTimeout(resolve));

/** A device that takes a write when the test lets it. */
class Device {
  taken = [];
  waiting = [];
  isSlow = false;
  isClosed = false;
  async open(options) {
    this.options = options;
    if (this.failure) throw this.failure;
  }
  read() {
    return new Promise((resolve) => (this.give = resolve));
  }
  write(data) {
    this.taken.push(String.fromCharCode(...data));
    return this.isSlow ? new Promise((resolve, reject) => this.waiting.push({ resolve, reject })) : Promise.resolve();
  }
  async close() {
    this.isClosed = true;
  }
}

let posted, device, ports;
const told = (kind) => posted.filter((message) => message[0] === kind).map(([, , text]) => text);

async function opened() {
  posted = [];
  device = new Device();
  ports = new Ports((...message) => posted.push(message), { find: async (url) => (url === "none" ? null : device) });
  ports.hear("port.open", 1, JSON.stringify({ url: "webserial://1a86:7523", baudrate: 9600 }));
  await turn();
  ports.hear("port.stop", 1, STOP);
}
beforeEach(async () => {
  isLocked = false;
  await opened();
});
const send = (text, epoch = 0) => ports.hear("port.frame", 1, `${epoch} ${text}`);
const move = (text, epoch = 0) => ports.hear("port.frame", 1, `${epoch}! ${text}`);

test("a port is opened, carries bytes of all values, and is closed", async () => {
  assert.deepEqual(posted, [["port.opened", 1, "0"]]);
  assert.equal(device.options.baudrate, 9600);
  send("\x00\xff M");
  device.give(Uint8Array.from([0, 255]));
  await turn();
  assert.deepEqual(device.taken, ["\x00\xff M"]);
  assert.deepEqual([told("port.data"), told("port.sent")], [["\x00\xff"], ["4"]]);
  ports.hear("port.close", 1, "");
  await turn();
  assert.ok(device.isClosed);
  assert.deepEqual(posted.at(-1), ["port.closed", 1, ""]);
  assert.equal(ports.isInUse, false);
});

for (const [why, prepare] of [
  ["absent", () => ports.hear("port.open", 2, JSON.stringify({ url: "none" }))],
  ["other tab", () => ((isLocked = true), (ports._lock = null), ports.hear("port.open", 2, '{"url":""}'))],
  ["in use", () => ((device.failure = new DOMException("", "NetworkError")), ports.hear("port.open", 2, '{"url":""}'))],
]) {
  test(`a port that cannot be opened says why: ${why}`, async () => {
    prepare();
    await turn();
    assert.deepEqual(posted.at(-1), ["port.failed", 2, why]);
  });
}

test("one frame at most is ahead of a stop at every position, and nothing moves after it", async () => {
  for (let position = 0; position < 100; position++) {
    await opened();
    device.isSlow = true;
    for (let number = 0; number < 100; number++) {
      (number % 10 ? move : send)(`<${number}>`);
      if (number === position) {
        ports.stop();
        assert.equal(device.taken.at(-1), STOP); // before anything else may run
        assert.deepEqual(posted.at(-1), ["port.stopped", 1, "1"]);
      }
    }
    for (let turns = 0; turns < 120; turns++) {
      device.waiting.shift()?.resolve();
      await Promise.resolve();
      await Promise.resolve();
      await Promise.resolve();
    }
    const at = device.taken.indexOf(STOP);
    assert.ok(at <= 1, String(at));
    const after = device.taken.slice(at + 1);
    assert.ok(
      after.every((frame) => Number(frame.slice(1, -1)) % 10 === 0),
      String(after),
    );
    assert.equal(after.length, at === 1 ? 9 : 10);
    assert.equal(told("port.sent").at(-1), String([...Array(100).keys()].map((n) => `<${n}>`).join("").length));
  }
});

test("a motion that the worker asks for after it knows of the stop is sent", async () => {
  ports.stop();
  move("old", 0);
  move("new", 1);
  await turn();
  assert.deepEqual(device.taken, [STOP, "new"]);
});

test("the rest of a long frame goes before the stop", async () => {
  device.isSlow = true;
  move("x".repeat(10_000));
  ports.stop();
  assert.deepEqual(
    device.taken.map((data) => data.length),
    [4096, 4096, 1808, 4],
  );
});

test("a stop of the worker goes before what waits, and drops motions that wait", async () => {
  device.isSlow = true;
  for (const text of ["a", "b"]) move(text);
  send("query");
  send(STOP);
  device.isSlow = false;
  device.waiting[0].resolve();
  await turn();
  assert.deepEqual(device.taken, ["a", STOP, "query"]);
});

test("a worker that ends is followed by a stop, and the port is closed", async () => {
  device.isSlow = true;
  move("a");
  move("b");
  ports.abandon();
  await turn();
  assert.deepEqual([device.taken, device.isClosed], [["a", STOP], true]);
});

test("a port is released without a stop, unless the page has moved its board", async () => {
  send("query");
  ports.release();
  assert.deepEqual(device.taken, ["query"]);
  await opened();
  move("a");
  ports.release();
  assert.deepEqual(device.taken, ["a", STOP]);
});

test("a device that is unplugged is told once, when reading or writing fails", async () => {
  device.give(null);
  await turn();
  assert.deepEqual(told("port.lost"), [""]);
  await opened();
  device.isSlow = true;
  send("a");
  device.waiting[0].reject(new DOMException("", "NetworkError"));
  await turn();
  assert.deepEqual(told("port.lost"), [""]);
});

test("a port that is closed while it opens is given back", async () => {
  ports.hear("port.open", 2, '{"url":""}');
  ports.hear("port.close", 2, "");
  await turn();
  assert.deepEqual(posted.at(-1), ["port.closed", 2, ""]);
});

/** A serial port with the streams, locks and errors of the specification. */
class Port {
  written = [];
  isOpen = false;
  getInfo = () => ({ usbVendorId: 0x1a86, usbProductId: 0x7523 });
  async open({ baudRate }) {
    if (this.isOpen) throw new DOMException("The port is already open.", "InvalidStateError");
    assert.equal(baudRate, 115200);
    this.isOpen = true;
    this.renew();
    this.writable = new WritableStream({ write: (data) => void this.written.push(...data) });
  }
  renew() {
    this.readable = new ReadableStream({ start: (controller) => void (this.line = controller) });
  }
  async setSignals(signals) {
    this.signals = signals;
  }
  async close() {
    if (this.readable?.locked || this.writable?.locked) throw new TypeError("Cannot close a locked stream.");
    this.isOpen = false;
  }
}

test("a serial port goes on after a disturbed byte, ends when it is unplugged, and is free after the close", async () => {
  const port = new Port(),
    serial = new SerialDevice(port);
  await serial.open({ url: "" });
  assert.deepEqual(port.signals, { dataTerminalReady: false, requestToSend: false });
  await serial.write(Uint8Array.of(1, 2));
  port.line.enqueue(Uint8Array.of(3));
  assert.deepEqual([port.written, await serial.read()], [[1, 2], Uint8Array.of(3)]);
  const next = serial.read();
  const { line } = port;
  port.renew();
  line.error(new DOMException("", "FramingError"));
  port.line.enqueue(Uint8Array.of(4));
  assert.deepEqual(await next, Uint8Array.of(4));
  const last = serial.read();
  port.line.error(new DOMException("The device has been lost.", "NetworkError"));
  port.readable = null;
  assert.equal(await last, null);
  await serial.close();
  assert.equal(port.isOpen, false);
});

test("a serial port that is closed ends its reading", async () => {
  const port = new Port(),
    serial = new SerialDevice(port);
  await serial.open({ url: "" });
  const reading = serial.read();
  await serial.close();
  assert.deepEqual([await reading, port.isOpen], [null, false]);
});

/** A USB device with two interfaces, of which the second one is the maker's. */
function bulkDevice() {
  const endpoint = (number, direction) => ({ endpointNumber: number, direction, type: "bulk", packetSize: 64 });
  const alternate = (interfaceClass, endpoints) => ({ alternateSetting: 0, interfaceClass, endpoints });
  const device = {
    configuration: null,
    calls: [],
    answers: [],
    open: async () => device.calls.push("open"),
    close: async () => device.calls.push("close"),
    selectConfiguration: async () => {
      device.configuration = {
        interfaces: [
          { interfaceNumber: 0, alternates: [alternate(10, [endpoint(1, "in"), endpoint(1, "out")])] },
          { interfaceNumber: 1, alternates: [alternate(0xff, [endpoint(2, "out"), endpoint(3, "in")])] },
        ],
      };
    },
    claimInterface: async (number) => device.calls.push(`claim ${number}`),
    transferIn: async () => device.answers.shift() ?? Promise.reject(new DOMException("gone", "NotFoundError")),
    transferOut: async (number, data) => (device.calls.push(`out ${number}: ${data.length}`), { status: "ok" }),
    clearHalt: async (direction, number) => device.calls.push(`clear ${direction} ${number}`),
  };
  return device;
}

test("a USB board is its maker's interface; an empty packet ends a frame whose last packet is full", async () => {
  const device = bulkDevice(),
    port = new BulkPort(device);
  await port.open();
  await port.write(new Uint8Array(64), false);
  await port.write(new Uint8Array(64), true);
  await port.write(new Uint8Array(12), true);
  assert.deepEqual(device.calls, ["open", "claim 1", "out 2: 64", "out 2: 64", "out 2: 0", "out 2: 12"]);
  device.answers.push({ status: "stall" }, { status: "ok", data: new DataView(Uint8Array.of(7).buffer) });
  assert.deepEqual([...(await port.read())], [7]);
  assert.equal(device.calls.at(-1), "clear in 3");
  await assert.rejects(port.read(), { name: "NotFoundError" });
});

test("a USB device without such an interface is refused with the reason", async () => {
  const device = bulkDevice();
  device.configuration = { interfaces: [] };
  await assert.rejects(new BulkPort(device).open(), /no vendor interface/);
});

test("an HID board takes frames in padded reports, and ends when it is unplugged", async () => {
  const report = (reportId) => ({ reportId, items: [{ reportSize: 8, reportCount: 16 }] });
  const sent = [];
  const device = Object.assign(new EventTarget(), {
    collections: [{ usagePage: 0xff00, inputReports: [report(2)], outputReports: [report(1)] }],
    open: async () => {},
    close: async () => {},
    sendReport: async (id, data) => void sent.push([id, ...data]),
  });
  posted = [];
  ports = new Ports((...message) => posted.push(message), { find: async () => new HidPort(device) });
  ports.hear("port.open", 1, '{"url":"webhid://1209:0001"}');
  await turn();
  ports.hear("port.stop", 1, STOP);
  send("a".repeat(20));
  await turn();
  assert.deepEqual(sent, [
    [1, ...Array(16).fill(97)],
    [1, ...Array(4).fill(97), ...Array(12).fill(0)],
  ]);
  const data = new DataView(Uint8Array.of(1, 2).buffer);
  for (const reportId of [1, 2])
    device.dispatchEvent(Object.assign(new Event("inputreport"), { device, reportId, data }));
  await turn();
  assert.deepEqual(told("port.data"), ["\x01\x02"]);
  navigator.hid.dispatchEvent(Object.assign(new Event("disconnect"), { device }));
  await turn();
  assert.deepEqual(told("port.lost"), [""]);
});
