// Files that Python keeps in the browser: the log of their changes, where the tab ends at any byte.

import assert from "node:assert/strict";
import { test } from "node:test";
import { KeptLog } from "../../../servolink/studio/web/worker/kept-files.js";
import { Store } from "../../pyodide/store.mjs";

const bytesOf = (/** @type {string} */ text) => new TextEncoder().encode(text);

/** @param {KeptLog} log */
const shown = (log) =>
  [...log.files].map(([path, { mode, content }]) => [path, mode, new TextDecoder().decode(content)]);

/** @param {KeptLog} log @param {string} path @param {string | null} text */
function write(log, path, text) {
  log.put(path, text === null ? null : { mode: 0o600, content: bytesOf(text) });
  log.flush();
}

const LONG = "x".repeat(1_500_000);
/** @type {[string, string | null][]} */
const WRITES = [
  ["/a/journal", "begun"],
  ["/a/backup", "old"],
  ["/a/journal", "written"],
  ["/a/journal", null],
];

test("files are there at the next visit, and what is gone is not", () => {
  const stores = /** @type {[Store, Store]} */ ([new Store({ left: Infinity }), new Store({ left: Infinity })]);
  for (const [path, text] of WRITES) write(new KeptLog(stores), path, text);
  assert.deepEqual(shown(new KeptLog(stores)), [["/a/backup", 0o600, "old"]]);
});

test("a tab that ends at any byte leaves the files of the last whole write", () => {
  for (let most = 0, ended = true; ended; most++) {
    const room = { left: most };
    const stores = /** @type {[Store, Store]} */ ([new Store(room), new Store(room)]);
    const states = [/** @type {any[]} */ ([])];
    ended = false;
    try {
      const log = new KeptLog(stores);
      for (const [path, text] of WRITES) {
        write(log, path, text);
        states.push(shown(log));
      }
    } catch {
      ended = true;
    }
    room.left = Infinity;
    assert.deepEqual(shown(new KeptLog(stores)), states.at(-1), `after ${most} bytes`);
    write(new KeptLog(stores), "/next", "visit");
    assert.deepEqual(shown(new KeptLog(stores)).at(-1), ["/next", 0o600, "visit"]);
  }
});

test("a long log is written anew, and a tab may end meanwhile", () => {
  for (const lost of [0, 1, 20, 60, 100, 140]) {
    const room = { left: Infinity };
    const stores = /** @type {[Store, Store]} */ ([new Store(room), new Store(room)]);
    const log = new KeptLog(stores);
    write(log, "/kept", "here");
    write(log, "/long", LONG);
    write(log, "/long", LONG);
    write(log, "/long", "short");
    const sum = () => stores[0].bytes.length + stores[1].bytes.length;
    const before = sum();
    log.put("/long", { mode: 0o600, content: bytesOf(LONG) });
    log.put("/long", { mode: 0o600, content: bytesOf("last") });
    room.left = lost;
    try {
      log.flush();
      assert.ok(sum() < 1000 && before > 3_000_000);
    } catch {
      room.left = Infinity;
    }
    assert.deepEqual(shown(new KeptLog(stores)), [
      ["/kept", 0o600, "here"],
      ["/long", 0o600, "last"],
    ]);
  }
});
