// Questions of programs that want to move the robot, for the person at this page.

import { effect, signal } from "../html.js";
import { hasBoard, mayMove, welcome } from "./robot.js";

/** @typedef {{ number: number, who: string, seconds: number, targets: Record<string, number>, record: "action" | "macro" | null, caption: string, warning: string }} Question */

/** Open questions, the oldest first. */
export const questions = signal(/** @type {Question[]} */ ([]));

/**
 * Show the questions of a board from now on, unless this page may only watch.
 * @param {import("../link/link.js").Link} link
 */
export function followQuestions(link) {
  /** @param {number} number */
  const without = (number) => questions.value.filter((each) => each.number !== number);
  link.on("question", (question) => (questions.value = [...without(question.number), question]));
  link.on("question.over", ({ number }) => (questions.value = without(number)));
  effect(() => {
    if (welcome.value === null) return;
    questions.value = []; // the connection is new
    if (hasBoard.value && mayMove.value) link.tell("question.show");
  });
}
