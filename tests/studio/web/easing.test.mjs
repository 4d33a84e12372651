// Easing of movements: easing.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import "./page.mjs";

const { bytesOf, eased } = await import("../../../servolink/studio/web/state/easing.js");

const STEPS = [
  { servo_id: 1, degree: 90, interval_ms: 1000 },
  { servo_id: 2, degree: -30, interval_ms: 400 },
];
const FROM = { 1: 0, 2: 0 };

test("a linear movement is the action itself", () => {
  const { parts, worst } = eased("linear", FROM, STEPS, 1);
  assert.deepEqual(parts, [STEPS.map((step) => ({ ...step, interval_ms: 1000 }))]);
  assert.ok(worst < 1e-9);
  assert.equal(bytesOf(parts), 38 + 10);
});

for (const curve of ["soft", "snap"])
  for (const error of [1, 2, 5, 20])
    test(`a ${curve} movement stays within ${error} degrees, takes its time and ends in the pose`, () => {
      const { parts, worst } = eased(curve, FROM, STEPS, error);
      assert.ok(worst <= error, String(worst));
      const times = parts.map((steps) => steps[0].interval_ms);
      assert.equal(
        times.reduce((sum, time) => sum + time, 0),
        1000,
      );
      assert.ok(parts.flat().every(({ interval_ms }) => interval_ms > 0 && interval_ms % 10 === 0));
      assert.deepEqual(
        parts.at(-1).map(({ servo_id, degree }) => [servo_id, degree]),
        [
          [1, 90],
          [2, -30],
        ],
      );
    });

test("less error costs more steps and bytes", () => {
  const [fine, coarse] = [1, 10].map((error) => eased("soft", FROM, STEPS, error).parts);
  assert.ok(fine.length > coarse.length && bytesOf(fine) > bytesOf(coarse));
  assert.ok(coarse.length >= 2);
});

test("soft begins and ends slowly, and snap begins quickly", () => {
  const first = (curve) => {
    const [step] = eased(curve, FROM, STEPS, 2).parts[0];
    return step.degree / step.interval_ms;
  };
  assert.ok(first("soft") < 0.09 && first("snap") > 0.09);
});

test("a servo that stands right already is sent its angle at the end", () => {
  const { parts } = eased("soft", { 1: 0 }, STEPS, 2);
  assert.ok(parts.slice(0, -1).every((steps) => steps.length === 1));
  assert.equal(parts.at(-1).length, 2);
});
