// Questions of programs: shown to whoever may move the robot, as long as they are open.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { FakeLink } from "./page.mjs";

const state = "../../../servolink/studio/web/state/";
const { followQuestions, questions } = await import(`${state}questions.js`);
const { welcome } = await import(`${state}robot.js`);

const link = new FakeLink();
followQuestions(link);
const question = (number) => ({ number, who: "a program", seconds: 1, targets: { 1: 30 }, record: null, caption: "" });
const numbers = () => questions.value.map((each) => each.number);

beforeEach(() => {
  link.told = [];
  welcome.value = { role: "edit", name: "rex", session: "mine" };
});

test("a page asks for questions with each new connection, if it may move a robot", () => {
  assert.deepEqual(link.told, ["question.show"]);
  welcome.value = { role: "watch", name: "rex", session: "mine" };
  welcome.value = { role: "edit", name: "", session: "mine" };
  assert.deepEqual(link.told, ["question.show"]);
});

test("a question stays until it is over, once, and not beyond the connection", () => {
  link.hear("question", question(1));
  link.hear("question", question(2));
  link.hear("question", question(1));
  assert.deepEqual(numbers(), [2, 1]);
  link.hear("question.over", { number: 2 });
  assert.deepEqual(numbers(), [1]);
  welcome.value = { ...welcome.value };
  assert.deepEqual(numbers(), []);
});
