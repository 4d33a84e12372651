// The guided first minute in the place of messages: one sentence for each step, and a way to the screen of the step.

import { html } from "../html.js";
import { Note } from "../parts/note.js";
import { beginTour, isKnown, isOffered, leaveTour, step, STEPS } from "../state/tour.js";
import { screen } from "../state/view.js";
import { t } from "../texts/text.js";

/** Present step of the tour, or its offer. */
export function Tour() {
  if (!isOffered.value) return null;
  if (step.value === null)
    return html`<button class="btn s" onClick=${beginTour}>${t(isKnown.value ? "tour.again" : "tour.begin")}</button>`;
  const { name, screen: place } = STEPS[step.value];
  const title = t("tour.step", { number: step.value + 1, count: STEPS.length, what: t(`tour.${name}`) });
  return html`<${Note} kind="info" title=${title} detail=${t(`tour.${name}_detail`)}>
    ${screen.value !== place && html`<a class="btn s" href=${`#${place}`}>${t("tour.go", { screen: t(/** @type {import("../texts/text.js").Key} */ (`screen.${place}`)) })}</a>`}
    <button class="btn s" onClick=${leaveTour}>${t("tour.leave")}</button>
  </${Note}>`;
}
