// Ports that a person has granted to this page: serial ports, USB and HID devices, by address and by name.

import { HidPort } from "./hid-port.js";
import { SerialDevice } from "./serial-port.js";
import { BulkPort } from "./usb-port.js";

/** @typedef {"webserial" | "webusb" | "webhid"} Scheme */
/** @typedef {import("./ports.js").Device} Device */
/** Port of the browser, with the functions of the page for it. @typedef {{ ids: [number | undefined, number | undefined], product: string, make: () => Device }} Described */
/** @typedef {{ property: "serial" | "usb" | "hid", list: (api: any) => Promise<any[]>, ask: (api: any) => Promise<any>, describe: (port: any) => Described }} Kind */

/** Names of makers of serial adapters, by vendor id: the browser gives none. @type {Record<number, string>} */
const MAKERS = {
  0x0403: "FTDI",
  0x0483: "STM32",
  0x067b: "Prolific",
  0x10c4: "Silicon Labs CP210x",
  0x1a86: "CH340",
  0x2341: "Arduino",
  0x2e8a: "Raspberry Pi Pico",
  0x303a: "Espressif",
};

/** Kinds of ports by scheme. Nothing is filtered in the lists of the browser, where filters would hide adapters. @type {Record<Scheme, Kind>} */
const KINDS = {
  webserial: {
    property: "serial",
    list: (api) => api.getPorts(),
    ask: (api) => api.requestPort(),
    describe: (port) => {
      const { usbVendorId, usbProductId } = port.getInfo();
      return {
        ids: [usbVendorId, usbProductId],
        product: MAKERS[usbVendorId] ?? "",
        make: () => new SerialDevice(port),
      };
    },
  },
  webusb: {
    property: "usb",
    list: (api) => api.getDevices(),
    ask: (api) => api.requestDevice({ filters: [] }),
    describe: (device) => ({ ...named(device), make: () => new BulkPort(device) }),
  },
  webhid: {
    property: "hid",
    list: (api) => api.getDevices(),
    ask: async (api) => (await api.requestDevice({ filters: [] }))[0],
    describe: (device) => ({ ...named(device), make: () => new HidPort(device) }),
  },
};

/** @param {{ vendorId: number, productId: number, productName?: string }} device @returns {Pick<Described, "ids" | "product">} */
const named = ({ vendorId, productId, productName = "" }) => ({ ids: [vendorId, productId], product: productName });

/** Return the object of the browser for a kind of ports; undefined for a browser without it. @param {Kind} kind */
const apiOf = ({ property }) => /** @type {any} */ (globalThis.navigator)?.[property];

/** Return the schemes whose ports this browser has. */
export const schemes = () => /** @type {Scheme[]} */ (Object.keys(KINDS)).filter((scheme) => apiOf(KINDS[scheme]));

/** Return the ports granted to this page, by address. @returns {Promise<Map<string, Described & { port: unknown }>>} */
export async function grantedPorts() {
  const found = new Map();
  for (const scheme of schemes()) {
    const kind = KINDS[scheme];
    for (const port of await kind.list(apiOf(kind))) {
      const described = kind.describe(port),
        place = `${scheme}://${described.ids.map(hex).join(":")}`;
      let url = place;
      for (let number = 2; found.has(url); number++) url = `${place}/${number}`;
      found.set(url, { ...described, port });
    }
  }
  return found;
}

const hex = (number = 0) => number.toString(16).padStart(4, "0");

/**
 * Let a person choose a port in the list of the browser, and return its address; null without a choice.
 * @param {Scheme} scheme
 * @returns {Promise<string | null>}
 */
export async function choosePort(scheme) {
  try {
    const chosen = await KINDS[scheme].ask(apiOf(KINDS[scheme]));
    return [...(await grantedPorts())].find(([, { port }]) => port === chosen)?.[0] ?? null;
  } catch {
    return null; // the person has closed the list
  }
}

/** Call `listener` when a granted port comes or goes. @param {() => void} listener */
export function onPorts(listener) {
  for (const scheme of schemes())
    for (const name of ["connect", "disconnect"]) apiOf(KINDS[scheme]).addEventListener(name, listener);
}
