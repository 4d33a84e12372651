// Messages of the hub, the studio and the doctor in the language of the page.

import { computed } from "../html.js";
import { texts } from "./text.js";

const NAME = /\{(\w+)\}/;

/** Templates, split at their names, those with most literal text first. */
const split = computed(() =>
  Object.values(texts.value.messages)
    .flatMap((messages) => Object.entries(messages))
    .map(([english, translation]) => {
      const parts = english.split(NAME);
      const literals = parts.filter((_, at) => at % 2 === 0);
      return { literals, names: parts.filter((_, at) => at % 2), translation, literal: literals.join("") };
    })
    .sort((one, other) => other.literal.length - one.literal.length),
);

/**
 * Return a message in the language of the page, each line that has a template.
 * @param {string} text
 */
export const said = (text) => (split.value.length === 0 ? text : text.split("\n").map(line).join("\n"));

/**
 * @param {string} text
 * @returns {string}
 */
function line(text) {
  for (const { literals, names, literal, translation } of split.value) {
    const values = valuesIn(text, literals);
    if (values === null) continue;
    const translated = values.map(line);
    // A template of punctuation alone fits any text with a colon.
    if (!/\w/.test(literal) && values.every((value, at) => value === translated[at])) continue;
    return translation.replace(new RegExp(NAME, "g"), (_, name) => translated[names.indexOf(name)]);
  }
  return text;
}

/**
 * Return the values between literals, each as short as possible; null if the text differs. Takes linear time, unlike a
 * regular expression.
 * @param {string} text
 * @param {string[]} literals
 */
function valuesIn(text, literals) {
  const [first, ...others] = literals;
  const last = others.pop();
  if (last === undefined) return text === first ? [] : null;
  const end = text.length - last.length;
  let from = first.length;
  if (!text.startsWith(first) || !text.endsWith(last)) return null;
  const values = [];
  for (const literal of others) {
    const at = text.indexOf(literal, from);
    if (at < 0) return null;
    values.push(text.slice(from, at));
    from = at + literal.length;
  }
  return from > end ? null : [...values, text.slice(from, end)];
}
