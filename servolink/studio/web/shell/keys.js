// Keys that work on every screen, and the list of all keys.

import { html } from "../html.js";
import { Dialog } from "../parts/dialog.js";
import { isTyping } from "../parts/hold.js";
import { isUnfinished } from "../parts/typing.js";
import { stop, stopsFleet } from "../parts/stop-button.js";
import { course } from "../state/code.js";
import { questions } from "../state/questions.js";
import { isFresh, isMine, isStill, lease } from "../state/robot.js";
import { mode, screen, showKeys } from "../state/view.js";
import { t } from "../texts/text.js";
import { redoEdit, undoEdit } from "./edits.js";
import { ENTRIES, entries } from "./rail.js";

/** @typedef {import("./app.js").Tools} Tools */
/** @typedef {import("../texts/text.js").Key} Key */

/** @type {[Key, [string, Key][]][]} */
const LIST = [
  [
    "keys.everywhere",
    [
      ["Esc", "keys.stop"],
      ["1 – 9", "keys.screens"],
      ["Ctrl Z", "keys.undo"],
      ["Ctrl Shift Z", "keys.redo"],
      ["?", "keys.list"],
    ],
  ],
  [
    "keys.figure",
    [
      ["← →", "keys.one_degree"],
      ["Shift ← →", "keys.ten_degrees"],
      ["↑ ↓", "keys.next_servo"],
      ["0", "keys.middle"],
      ["M", "keys.mirror"],
      ["G", "keys.ghost"],
    ],
  ],
  [
    "keys.preview",
    [
      ["Space", "keys.play"],
      ["Home", "keys.to_start"],
      [", .", "keys.one_step"],
      ["Ctrl D", "keys.duplicate"],
      ["Alt ← →", "keys.move_clip"],
      ["Delete", "keys.remove_clip"],
    ],
  ],
  [
    "keys.recording",
    [
      ["R", "keys.record"],
      ["F", "keys.freeze"],
      ["K", "keys.mark"],
    ],
  ],
  [
    "keys.robot",
    [
      ["H", "keys.hold"],
      ["L", "keys.lease"],
      ["Space", "keys.take"],
      ["U", "keys.forget"],
    ],
  ],
];

/** Page of the documentation about each screen. @type {Record<string, string>} */
const PAGES = {
  actions: "tutorial/first-robot",
  macros: "tutorial/first-robot",
  buttons: "tutorial/first-robot",
  blocks: "how-to/studio#program-with-blocks",
  code: "how-to/without-installation",
  record: "how-to/recordings",
  project: "how-to/save-and-restore",
  board: "how-to/learn-a-board",
  servos: "how-to/studio#set-servos-up",
  fleet: "how-to/fleet-classroom",
};

/** What the screen is for, and where the documentation tells more. */
const Guide = () => {
  const page = PAGES[screen.value] ?? "how-to/studio";
  return html`<section class="guide" aria-labelledby="guide-title">
  <h3 id="guide-title">${t("guide.title", { screen: t(ENTRIES.find(({ name }) => name === screen.value)?.title ?? "screen.live") })}</h3>
  <p>${t(/** @type {Key} */ (`guide.${screen.value}`))}</p>
  <p class="mut">${t("guide.docs")} <a href=${`docs/${page}`} target="_blank" rel="noopener">${page}</a></p>
</section>`;
};

/** Dialog with a guide to the screen, and a list of all keys. */
export function KeyList() {
  return html`<${Dialog} title=${t("app.keys")} onClose=${() => showKeys(false)}>
    <${Guide} />
    <div class="keys">
      ${LIST.map(
        ([title, keys]) => html`<h3>${t(title)}</h3>
          ${keys.map(([key, does]) => html`<div><span>${t(does)}</span><span>${key.split(" ").map((each) => html`<kbd>${each}</kbd> `)}</span></div>`)}`,
      )}
    </div>
  </${Dialog}>`;
}

/**
 * Return whether an element belongs to blocks or to a program in Python, which have keys of their own.
 * @param {EventTarget | null} target
 */
const hasOwnKeys = (target) =>
  target instanceof Element &&
  target.closest(".blockspace, .blocklyWidgetDiv, .blocklyDropDownDiv, .codespace") !== null;

/** Return whether nothing moves, and this page moves nothing: Preview, no lease, and servos that were read and rest. */
const isAtRest = () =>
  !stopsFleet() &&
  mode.value === "preview" &&
  lease.value === null &&
  questions.value.length === 0 &&
  course.value !== "running" &&
  isFresh.value &&
  isStill();

/**
 * Listen to the keys of every screen. STOP works in text fields and dialogs too. Escape closes what is open, and stops
 * unless this page is in Preview, nothing moves, and no program asks to move the robot.
 * @param {Tools} tools
 */
export function listenToKeys(tools) {
  // In the first phase, before anything else can take the key.
  addEventListener(
    "keydown",
    (event) => {
      if (event.key === "Escape" && !event.repeat && !isAtRest()) stop(tools);
    },
    { capture: true },
  );
  addEventListener("keydown", (event) => {
    if (
      isUnfinished(event.target) ||
      hasOwnKeys(event.target) ||
      !(event.ctrlKey || event.metaKey) ||
      event.altKey ||
      event.key.toLowerCase() !== "z"
    )
      return;
    event.preventDefault();
    if (event.shiftKey) redoEdit();
    else undoEdit();
  });
  addEventListener("keydown", (event) => {
    if (
      isTyping(event.target) ||
      hasOwnKeys(event.target) ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      event.repeat
    )
      return;
    const entry = entries()[Number(event.key) - 1];
    if (event.key === "?") showKeys(true);
    else if (event.key.toLowerCase() === "l" && isMine.value) tools.motion.leave();
    else if (entry !== undefined) location.hash = entry.name;
  });
}
