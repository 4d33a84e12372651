// Set-up of servos: servo-setup.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import "./page.mjs";

const { corrected, movedServo, widened } = await import("../../../servolink/studio/web/state/servo-setup.js");

test("the servo that has moved most is found, once it has moved enough", () => {
  assert.equal(movedServo({ 1: 0, 2: 10 }, { 1: 7, 2: 10 }), null);
  assert.equal(movedServo({ 1: 0, 2: 10 }, { 1: 8, 2: -10 }), 2);
  assert.equal(movedServo({ 1: 0 }, { 1: 0, 3: 90 }), null); // plugged in meanwhile
});

test("a range grows to the angles that were reached, and stays the same object otherwise", () => {
  const range = [-5, 10];
  assert.equal(widened(range, 3), range);
  assert.deepEqual(widened(range, -6), [-6, 10]);
  assert.deepEqual(widened(range, 11), [-5, 11]);
});

test("the correction is the old one and the nudges, within the limits of servolink", () => {
  assert.equal(corrected(3, -4, 1), 8);
  assert.equal(corrected(170, 0, 90), 180);
  assert.equal(corrected(-170, 0, -90), -180);
});
