// A newer version of a page without a server is offered while nothing real can move, and loaded after a press only.

import assert from "node:assert/strict";
import { mock, test } from "node:test";
import "./page.mjs";

/** @type {any[]} */
const posted = [];
const newer = {
  state: "installed",
  addEventListener: () => {},
  postMessage: (/** @type {string} */ text, /** @type {MessagePort[]} */ [port]) => {
    posted.push(text);
    port.close(); // or it would keep this program running
  },
};
const registration = { waiting: newer, installing: null, addEventListener: () => {} };
const serviceWorker = Object.assign(new EventTarget(), { controller: {}, register: async () => registration });
Object.defineProperty(globalThis, "navigator", {
  configurable: true,
  value: { serviceWorker, storage: { persist: async () => true } },
});
const web = "../../../servolink/studio/web/";
const { followVersions } = await import(`${web}state/versions.js`);
const { welcome } = await import(`${web}state/robot.js`);
const { toasts } = await import(`${web}state/toasts.js`);

mock.timers.enable({ apis: ["setTimeout"] }); // of toasts, which would last longer than the test
const offers = () => toasts.value.filter(({ name }) => name === "newer");
const connect = (/** @type {boolean} */ is_virtual) => (welcome.value = { name: "rex", role: "edit", is_virtual });

test("while a robot is connected nothing is offered, and an offer of before is refused", async () => {
  connect(false);
  await followVersions();
  assert.equal(offers().length, 0);
  connect(true);
  assert.equal(offers().length, 1);
  connect(false);
  offers()[0].action.run();
  assert.deepEqual(posted, []);
  assert.match(toasts.value.at(-1).title, /robot/);
  connect(true);
  offers()[0].action.run();
  assert.deepEqual(posted, ["replace"]);
});
