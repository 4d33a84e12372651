// Names of the parts of figures: words of the ids of joints, such as `r_shoulder`.

import { language, texts } from "./text.js";

/**
 * Return the name of a part in the language of the page; unknown words stay.
 * @param {string} id of a joint
 */
export function partName(id) {
  const words = id.split("_"),
    names = words.map((word) => texts.value.texts[`part.${word}`]);
  const isKnown = names.every((name) => name !== undefined);
  return words.map((word, at) => names[at] ?? word).join(language.value !== "en" && isKnown ? "" : " ");
}
