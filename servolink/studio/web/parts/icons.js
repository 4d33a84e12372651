// The icons: shapes on a field of 24 by 24, drawn with the colour of the text.

/** @typedef {[string, Record<string, string>]} Shape */

/** @type {Record<string, Shape[]>} */
export const ICONS = {
  live: [
    ["circle", { cx: "12", cy: "5", r: "2.5" }],
    ["path", { d: "M12 8v7M6 9.5 12 11l6-1.5M9 21l3-6 3 6" }],
  ],
  actions: [
    ["circle", { cx: "9", cy: "5", r: "2" }],
    ["path", { d: "M9 7.5v6M4.5 8.5 9 9.5l4-3M6.5 20 9 13.5l2.5 6.5M17 13v6M14 16h6" }],
  ],
  macros: [
    ["rect", { x: "3", y: "5", width: "10", height: "4", rx: "1.5" }],
    ["rect", { x: "8", y: "10.5", width: "13", height: "4", rx: "1.5" }],
    ["rect", { x: "5", y: "16", width: "9", height: "4", rx: "1.5" }],
  ],
  buttons: [
    ["path", { d: "M7 8h10a5 5 0 0 1 5 5.5c0 3-2 4.5-3.6 3L16.5 15h-9l-1.9 1.5C4 18 2 16.5 2 13.5A5 5 0 0 1 7 8Z" }],
    ["path", { d: "M7.5 10.5v3M6 12h3M16 11.2h.01M17.6 12.8h.01" }],
  ],
  teach: [
    [
      "path",
      {
        d: "M8 12V5.5a1.5 1.5 0 0 1 3 0V11m0-1V4.5a1.5 1.5 0 0 1 3 0V11m0-4.5a1.5 1.5 0 0 1 3 0V15a6 6 0 0 1-6 6c-2.5 0-4-1-5.2-3L4 14.5a1.5 1.5 0 0 1 2.6-1.5L8 15",
      },
    ],
  ],
  blocks: [["path", { d: "M4 4h5v2.5h4V4h7v6h-5v2.5h-4V10H4zM4 14h5v2.5h4V14h7v6H4z" }]],
  code: [["path", { d: "M8 7l-5 5 5 5M16 7l5 5-5 5M13.5 5l-3 14" }]],
  record: [
    ["path", { d: "M3 17l4-7 4 4 4-9 3 6h3" }],
    ["path", { d: "M3 21h18" }],
  ],
  project: [
    ["path", { d: "M6 3h8l4 4v14H6z" }],
    ["path", { d: "M14 3v4h4M9 12h6M9 16h4" }],
  ],
  board: [["path", { d: "M9 7V3M15 7V3M7 7h10v4a5 5 0 0 1-10 0zM12 16v5" }]],
  undo: [["path", { d: "M8 5 4 9l4 4M4 9h9a6 6 0 0 1 0 12h-3" }]],
  redo: [["path", { d: "m16 5 4 4-4 4M20 9h-9a6 6 0 0 0 0 12h3" }]],
  sun: [
    ["circle", { cx: "12", cy: "12", r: "4" }],
    ["path", { d: "M12 3v1.5M12 19.5V21M3 12h1.5M19.5 12H21M5.6 5.6l1 1M17.4 17.4l1 1M5.6 18.4l1-1M17.4 6.6l1-1" }],
  ],
  moon: [["path", { d: "M20 14.5A8 8 0 0 1 9.5 4 8 8 0 1 0 20 14.5Z" }]],
  language: [
    ["circle", { cx: "12", cy: "12", r: "9" }],
    ["path", { d: "M3 12h18M12 3c2.5 2.6 3.8 5.6 3.8 9s-1.3 6.4-3.8 9c-2.5-2.6-3.8-5.6-3.8-9S9.5 5.6 12 3Z" }],
  ],
  help: [
    ["circle", { cx: "12", cy: "12", r: "9" }],
    ["path", { d: "M9.5 9.3a2.6 2.6 0 1 1 3.7 2.4c-.8.4-1.2.9-1.2 1.8M12 16.8h.01" }],
  ],
  lock: [
    ["rect", { x: "5", y: "11", width: "14", height: "9", rx: "2" }],
    ["path", { d: "M8 11V8a4 4 0 0 1 8 0v3" }],
  ],
  hand: [
    [
      "path",
      {
        d: "M7 12.5V7a1.5 1.5 0 0 1 3 0m0 4V5a1.5 1.5 0 0 1 3 0v6m0-4.5a1.5 1.5 0 0 1 3 0V12m0-2.5a1.5 1.5 0 0 1 3 0V15a6 6 0 0 1-6 6h-1.5a6 6 0 0 1-5-2.7L4 14a1.5 1.5 0 0 1 2.4-1.7L7 13",
      },
    ],
  ],
  play: [["path", { d: "M7 4.5v15l12-7.5z", fill: "currentColor" }]],
  pause: [["path", { d: "M8 5v14M16 5v14", "stroke-width": "3" }]],
  loop: [["path", { d: "M17 3l3 3-3 3M20 6H8a4 4 0 0 0-4 4v1M7 21l-3-3 3-3M4 18h12a4 4 0 0 0 4-4v-1" }]],
  start: [["path", { d: "M18 5v14L8 12zM6 5v14", fill: "currentColor" }]],
  mirror: [["path", { d: "M12 3v18M9 7 3 17h6zM15 7l6 10h-6z" }]],
  warn: [["path", { d: "M12 4 2.8 19.5h18.4zM12 10v4.5M12 17.2h.01" }]],
  info: [
    ["circle", { cx: "12", cy: "12", r: "9" }],
    ["path", { d: "M12 11v5.5M12 7.8h.01" }],
  ],
  check: [["path", { d: "m5 12.5 4.5 4.5L19 7.5" }]],
  close: [["path", { d: "M6 6l12 12M18 6 6 18" }]],
  plus: [["path", { d: "M12 5v14M5 12h14" }]],
  search: [
    ["circle", { cx: "11", cy: "11", r: "6.5" }],
    ["path", { d: "m16 16 4.5 4.5" }],
  ],
  camera: [
    ["path", { d: "M4 8h3l1.5-2.5h7L17 8h3v11H4z" }],
    ["circle", { cx: "12", cy: "13", r: "3.5" }],
  ],
  clock: [
    ["circle", { cx: "12", cy: "12", r: "8.5" }],
    ["path", { d: "M12 7.5V12l3 2" }],
  ],
  eye: [
    ["path", { d: "M2.5 12S6 5.5 12 5.5 21.5 12 21.5 12 18 18.5 12 18.5 2.5 12 2.5 12Z" }],
    ["circle", { cx: "12", cy: "12", r: "3" }],
  ],
  more: [["path", { d: "M5 12h.01M12 12h.01M19 12h.01", "stroke-width": "3" }]],
  down: [["path", { d: "m6 9 6 6 6-6" }]],
  right: [["path", { d: "m9 6 6 6-6 6" }]],
  left: [["path", { d: "m15 6-6 6 6 6" }]],
  arrow: [["path", { d: "M5 12h14M13 6l6 6-6 6" }]],
  copy: [
    ["rect", { x: "8", y: "8", width: "12", height: "12", rx: "2" }],
    ["path", { d: "M16 8V4H4v12h4" }],
  ],
  paste: [
    ["rect", { x: "6", y: "5", width: "12", height: "16", rx: "2" }],
    ["path", { d: "M9 5V3.5h6V5M9.5 11h5M9.5 15h5" }],
  ],
  save: [["path", { d: "M12 3v12m-5-5 5 5 5-5M4 20h16" }]],
  rollback: [["path", { d: "M4 5v5h5M4.5 10a8 8 0 1 1-.4 4" }]],
  zoom: [
    ["circle", { cx: "11", cy: "11", r: "6.5" }],
    ["path", { d: "m16 16 4.5 4.5M8.5 11h5M11 8.5v5" }],
  ],
  "zoom-out": [
    ["circle", { cx: "11", cy: "11", r: "6.5" }],
    ["path", { d: "m16 16 4.5 4.5M8.5 11h5" }],
  ],
  battery: [
    ["rect", { x: "3", y: "8", width: "15", height: "9", rx: "2" }],
    ["path", { d: "M21 11v3" }],
  ],
  chip: [
    ["rect", { x: "6", y: "6", width: "12", height: "12", rx: "2" }],
    ["path", { d: "M9 2v4M15 2v4M9 18v4M15 18v4M2 9h4M2 15h4M18 9h4M18 15h4" }],
  ],
  usb: [
    ["path", { d: "M12 21V4m0 0L9.5 7M12 4l2.5 3M12 16l-5-3v-3M12 14l5-3V8" }],
    ["circle", { cx: "7", cy: "9", r: "1.3" }],
  ],
  wifi: [["path", { d: "M3 9a13 13 0 0 1 18 0M6.5 12.5a8 8 0 0 1 11 0M9.7 16a3.4 3.4 0 0 1 4.6 0M12 19.3h.01" }]],
  "down-long": [["path", { d: "M12 5v14M6 13l6 6 6-6" }]],
  press: [
    ["path", { d: "M12 3v9m-4-4 4 4 4-4" }],
    ["rect", { x: "5", y: "15", width: "14", height: "5", rx: "2" }],
  ],
  "long-press": [
    ["path", { d: "M12 3v9m-4-4 4 4 4-4M5 20h14" }],
    ["path", { d: "M5 16.5h14" }],
  ],
  up: [
    ["path", { d: "M12 12V3M8 7l4-4 4 4" }],
    ["rect", { x: "5", y: "15", width: "14", height: "5", rx: "2" }],
  ],
  feather: [["path", { d: "M4 20 14 10M20 4c-7 0-13 4-13 11v2h2c7 0 11-6 11-13Z" }]],
  fleet: [
    ["circle", { cx: "6", cy: "7", r: "2.5" }],
    ["circle", { cx: "18", cy: "7", r: "2.5" }],
    ["circle", { cx: "12", cy: "5.5", r: "2.5" }],
    [
      "path",
      { d: "M2.5 17v-1.5a3.5 3.5 0 0 1 7 0V17M14.5 17v-1.5a3.5 3.5 0 0 1 7 0V17M8.5 19.5V15a3.5 3.5 0 0 1 7 0v4.5" },
    ],
  ],
  grid: [
    ["rect", { x: "4", y: "4", width: "7", height: "7", rx: "1.5" }],
    ["rect", { x: "13", y: "4", width: "7", height: "7", rx: "1.5" }],
    ["rect", { x: "4", y: "13", width: "7", height: "7", rx: "1.5" }],
    ["rect", { x: "13", y: "13", width: "7", height: "7", rx: "1.5" }],
  ],
};
