// Questions to the library, whose rules of editing the page does not have. A gesture never waits for an answer.

import { effect, signal } from "../html.js";
import { linkState } from "./robot.js";

/** @typedef {import("../link/link.js").Link} Link */

const link = signal(/** @type {Link | null} */ (null));

/**
 * Ask over a connection, from now on.
 * @param {Link} connected
 */
export function followLibrary(connected) {
  link.value = connected;
}

/**
 * Return the answer of the library. Rejects with RequestError or LinkLost.
 * @param {string} method
 * @param {object} params
 * @returns {Promise<any>}
 */
export async function ask(method, params) {
  return /** @type {Link} */ (link.value).call(method, params);
}

/**
 * Return a signal with the answer to a question that changes: of several changes, only the latest is asked. The answer
 * before stays until the next one comes.
 * @template A
 * @param {string} method
 * @param {() => object | null} question its parameters, from signals; null for no question
 * @param {A} none value before the first answer, and without a question
 */
export function answered(method, question, none) {
  const answer = signal(none);
  let isAsking = false;
  /** @type {object | null} */
  let next = null;
  const askNext = async () => {
    if (isAsking) return;
    isAsking = true;
    while (next !== null) {
      const params = next;
      next = null;
      const found = await ask(method, params).catch(() => none);
      if (next === null) answer.value = found;
    }
    isAsking = false;
  };
  effect(() => {
    next = link.value !== null && linkState.value === "open" ? question() : null;
    void askNext();
  });
  return answer;
}
