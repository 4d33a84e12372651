// Guided first minute on a virtual robot: six steps, each of which waits for the real thing.

import { computed, effect, signal } from "../html.js";
import { targets } from "./motion.js";
import { outcome } from "./plan.js";
import { draft } from "./project.js";
import { mayEdit, welcome } from "./robot.js";
import { isAllStopped } from "./stopped.js";
import { forBrowser } from "./storage.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {{ name: "move" | "pose" | "macro" | "button" | "write" | "stop", screen: string, mark: () => unknown }} Step */

const KEY = "servolink.tour";

/** @param {Project | null} project */
const commandsOf = (project) =>
  project && JSON.stringify(project.macros.map((one) => one.commands.map((each) => [each.type, each.action_id])));

/** The steps, each with a mark that changes when the step is done, false before. @type {readonly Step[]} */
export const STEPS = [
  { name: "move", screen: "live", mark: () => Object.keys(targets.value).length > 0 && targets.value },
  { name: "pose", screen: "actions", mark: () => draft.value && JSON.stringify(draft.value.actions) },
  { name: "macro", screen: "macros", mark: () => commandsOf(draft.value) },
  { name: "button", screen: "buttons", mark: () => draft.value && JSON.stringify(draft.value.joystick_tables) },
  { name: "write", screen: "project", mark: () => outcome.value.state === "written" },
  { name: "stop", screen: "live", mark: () => isAllStopped.value },
];

/** Index of the present step; null outside of the tour. */
export const step = signal(/** @type {number | null} */ (null));
/** Whether the tour is offered: the robot is virtual, and the page may edit. */
export const isOffered = computed(() => welcome.value?.is_virtual === true && mayEdit.value);
/** Whether the tour was done or left in this browser. */
export const isKnown = signal(forBrowser.get(KEY) !== null);

/** Mark of the present step when it began; undefined until the board was read. */
let before = /** @type {unknown} */ (undefined);

/** @param {number} at */
function go(at) {
  before = undefined;
  step.value = at;
}

/** Begin with the first step. */
export const beginTour = () => go(0);

/** Leave the tour, which can be begun again. */
export function leaveTour() {
  step.value = null;
  isKnown.value = true;
  forBrowser.set(KEY, "known");
}

effect(() => {
  if (step.value === null) return;
  const mark = STEPS[step.value].mark();
  if (mark === null) return; // the board is being read
  const isDone = before !== undefined && mark !== false && mark !== before;
  if (before === undefined || mark === false) before = mark;
  if (!isDone) return;
  if (step.value + 1 < STEPS.length) go(step.value + 1);
  else leaveTour();
});
