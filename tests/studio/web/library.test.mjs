// Questions to the library: library.js and mirror.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import { FakeLink, turns } from "./page.mjs";

const state = "../../../servolink/studio/web/state/";
const { answered, followLibrary } = await import(`${state}library.js`);
const { mirror, mirrored, rightToLeft } = await import(`${state}mirror.js`);
const { captions, linkState } = await import(`${state}robot.js`);

const link = new FakeLink();
followLibrary(link);
linkState.value = "open";

test("of questions that change fast, only the latest is asked, and the answer before stays until it is there", async () => {
  const texts = answered("project.test", () => ({ text: captions.value[9] ?? "" }), "none");
  captions.value = { 9: "a" };
  captions.value = { 9: "b" };
  link.taken("project.test").resolve("first");
  await turns();
  assert.equal(texts.value, "none");
  const second = link.taken("project.test");
  assert.deepEqual(second.params, { text: "b" });
  second.resolve("second");
  await turns();
  assert.equal(texts.value, "second");
  captions.value = { 9: "c" };
  assert.equal(texts.value, "second");
  link.taken("project.test").reject(new Error("lost"));
  await turns();
  assert.equal(texts.value, "none");
});

test("steps are mirrored as the library has said", async () => {
  captions.value = { 1: "L", 2: "R" };
  link.taken("project.images").reject(new Error("answered too late")); // that of the captions before
  await turns();
  const images = { 1: { servo: 2, factor: -1, offset: 0, is_right: false }, 2: { servo: 1, factor: -1, offset: 0.4, is_right: true } }; // prettier-ignore
  link.taken("project.images").resolve({ images });
  await turns();
  const steps = [{ servo_id: 1, degree: 5 }, { servo_id: 2, degree: 30 }, { servo_id: 3, degree: 7 }]; // prettier-ignore
  assert.deepEqual(mirrored(steps, mirror.value), [
    { servo_id: 2, degree: -5 },
    { servo_id: 1, degree: -30 },
    { servo_id: 3, degree: 7 },
  ]);
  assert.deepEqual(rightToLeft(steps, mirror.value), [
    { servo_id: 1, degree: -30 },
    { servo_id: 2, degree: 30 },
    { servo_id: 3, degree: 7 },
  ]);
});
