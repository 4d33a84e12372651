// Scales of plots: stretch.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import "./page.mjs";

const { scaleOf } = await import("../../../servolink/studio/web/state/stretch.js");

test("a scale has round ends around all values", () => {
  assert.deepEqual(scaleOf(-33, 12, 60), [-60, 20]);
  assert.deepEqual(scaleOf(-170, 165, 60), [-200, 200]);
  assert.deepEqual(scaleOf(41, 43, 20), [30, 55]);
});

test("a scale without values, or with one, has the least span", () => {
  assert.deepEqual(scaleOf(null, null, 60), [-30, 30]);
  const [low, high] = scaleOf(7, 7, 60);
  assert.ok(low <= 7 && high >= 7 && high - low >= 60);
});
