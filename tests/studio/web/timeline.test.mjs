// Places of the numbers below short clips: timeline.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import "./page.mjs";

const { apart } = await import("../../../servolink/studio/web/state/timeline.js");

test("numbers are apart, as near their clips as the others allow, and within the lane", () => {
  assert.deepEqual(apart([], 26, 500), []);
  assert.deepEqual(apart([100, 200], 26, 500), [100, 200]);
  assert.deepEqual(apart([60, 200, 202, 204], 26, 500), [60, 176, 202, 228]);
  assert.deepEqual(apart([0, 1, 499, 500], 26, 500), [13, 39, 461, 487]);
  assert.deepEqual(apart([1, 2, 3, 4], 26, 104), [13, 39, 65, 91]);
});
