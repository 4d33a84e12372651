// Buttons: macros started by the buttons of the remote control, and presses here or on a gamepad.

import { html, useEffect, useRef, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Reading } from "../../parts/reading.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { counts, down, heard } from "../../state/button-events.js";
import { macroSeconds } from "../../state/durations.js";
import { beginLasting } from "../../state/lasting.js";
import { refusal, running } from "../../state/motion.js";
import {
  chooseButton,
  chooseTable,
  chosenButton,
  chosenTable,
  gamepadName,
  pressed,
  Presses,
} from "../../state/pad.js";
import { draft, isCurrent, stored } from "../../state/project.js";
import { isLive, mayEdit, mayMove } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { chooseMode, mode } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { Assign, macroName } from "./assign.js";
import { buttonOf, isSet } from "../../state/edit-buttons.js";
import { useGamepad } from "./gamepad.js";
import { Grid } from "./grid.js";
import { isGamepad, PLACES } from "./layout.js";
import { Pad } from "./pad.js";
import { addTable, Tables } from "./tables.js";

/** @typedef {import("../../texts/text.js").Key} Key */
/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../state/records.js").Project} Project */
/** @typedef {import("../../state/records.js").Table} Table */

const narrow = matchMedia("(max-width: 760px)"); // too narrow to hit the buttons of a drawn gamepad

/** @param {Tools} tools */
export function ButtonsScreen(tools) {
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="buttons" />`;
  const project = draft.value,
    table = shownTable(project);
  if (table === undefined) return html`<${NoTables} project=${project} />`;
  return html`<${Content} ...${{ project, table }} ...${tools} />`;
}

/** @param {{ project: Project, table: Table } & Tools} props */
function Content({ project, table, motion }) {
  const lasts = macroSeconds(project),
    isNarrow = useIsNarrow();
  const { press, release, end } = usePresses(motion);
  /** @param {number} id */
  const choose = (id) => {
    chooseButton(id);
    if (mode.value === "robot") press(id);
  };
  useGamepad(choose, release, end);
  const of = (/** @type {number} */ id) => buttonOf(table, id);
  const shown = {
    chosen: chosenButton.value,
    isSet: (/** @type {number} */ id) => isSet(of(id)),
    isDown: (/** @type {number} */ id) => down.value.has(id) || pressed.value.has(id),
    caption: (/** @type {number} */ id) => safeText(of(id).button_caption),
    macro: (/** @type {number} */ id) =>
      macroName(project, of(id).button_press_macro || of(id).button_long_press_macro),
    onPress: choose,
    onRelease: release,
  };
  const ids = idsOf(table, chosenButton.value);
  return html`<div class="btns">
    <section class="card pad2">
      <header class="wrap"><h1>${t("screen.buttons")}</h1>
        <${Tables} ...${{ project, table }} onChoose=${show} />
      </header>
      <div class="row pad0 wrap">
        <${Mode} />
        <${Hint} />
        <span class="grow"></span><${EventCount} />
      </div>
      ${isGamepad(ids) && !isNarrow ? html`<${Pad} ...${shown} />` : html`<${Grid} ids=${ids} onAdd=${chooseButton} ...${shown} />`}
      <${EventLog} macroOf=${(/** @type {number} */ id, /** @type {string} */ kind) => macroName(stored.value, startedBy(id, kind))} />
    </section>
    ${mayEdit.value && html`<${Assign} key=${`${table.table_id} ${chosenButton.value}`} ...${{ project, table, lasts }} id=${chosenButton.value} />`}
  </div>`;
}

/**
 * Return the buttons to show: buttons of the table, of events so far, and of a common gamepad if the board may have one.
 * @param {Table} table
 * @param {number} chosen
 */
function idsOf(table, chosen) {
  const known = [chosen, ...table.buttons.map((each) => each.button_id), ...heard.value.map(({ id }) => id)];
  const usual = isGamepad(known) ? PLACES.map(({ id }) => id) : [];
  return [...new Set([...usual, ...known])].sort((a, b) => a - b);
}

/** The macro that runs, or else a hint about presses. */
function Hint() {
  const macro = running.value?.type === "macro" && macroName(stored.value, running.value.id);
  if (macro)
    return html`<span class="chip ok" role="status"><${Icon} name="play" />${t("buttons.runs", { macro })}</span>`;
  const hint = mode.value === "robot" && isLive.value ? t("buttons.press_here") : t("buttons.lights_up");
  return html`<span class="chip acc"><${Icon} name="info" />${gamepadName.value ? t("buttons.gamepad", { name: gamepadName.value }) : hint}</span>`;
}

function Mode() {
  if (!mayMove.value) return null;
  return html`<${Segments} small label=${t("live.robot_mode")} value=${isLive.value ? mode.value : "preview"}
    onChoose=${chooseMode}
    choices=${[
      { value: "preview", label: t("buttons.assign"), icon: "eye" },
      { value: "robot", label: t("live.robot_mode"), icon: "live" },
    ]} />`;
}

/** @param {number} id */
function show(id) {
  chooseTable(id);
  chooseButton(draft.value?.joystick_tables.find((table) => table.table_id === id)?.buttons[0]?.button_id ?? 1);
}

/** Return whether the page is too narrow for the drawn gamepad, now and after each change. */
function useIsNarrow() {
  const [isNarrow, setNarrow] = useState(narrow.matches);
  useEffect(() => {
    const look = () => setNarrow(narrow.matches);
    look();
    narrow.addEventListener("change", look);
    return () => narrow.removeEventListener("change", look);
  }, []);
  return isNarrow;
}

/** @param {{ project: Project }} props */
const NoTables = ({ project }) => html`<div class="card empty">
  <${Icon} name="buttons" />
  <h1>${t("buttons.none")}</h1>
  <p>${t("buttons.none_detail")}</p>
  <div class="row">
    <button class="btn pri" onClick=${() => chooseTable(addTable(project))}>${t("buttons.begin")}</button>
    <a class="btn" href="#project">${t("buttons.open_file")}</a>
  </div>
</div>`;

/**
 * Return functions that press and release a button on the robot. Leaving the screen, or Robot mode, stops what was started.
 * @param {import("../../state/motion.js").Motion} motion
 */
function usePresses(motion) {
  const presses = useRef(/** @type {Presses | null} */ (null));
  presses.current ??= new Presses({
    button: (id) => buttonOf(stored.value && isCurrent.value ? shownTable(stored.value) : undefined, id),
    seconds: (macroId) => (stored.value && macroSeconds(stored.value).get(macroId)) ?? 0,
    run: (macroId, seconds) => beginLasting(() => run(motion, macroId, seconds)),
  });
  const made = presses.current;
  const end = () => {
    made.drop();
    if (motion.endRun()) toast({ icon: "hand", title: t("buttons.stopped"), detail: t("buttons.stopped_detail") });
  };
  useEffect(() => (mode.value === "robot" ? end : undefined), [mode.value]);
  useEffect(() => {
    const drop = () => made.drop();
    addEventListener("blur", drop);
    return () => removeEventListener("blur", drop);
  }, []);
  return {
    press: (/** @type {number} */ id) => {
      sayUnwritten(id);
      made.press(id);
    },
    release: (/** @type {number} */ id) => made.release(id),
    end,
  };
}

/**
 * @param {import("../../state/motion.js").Motion} motion
 * @param {number} macroId
 * @param {number} seconds
 */
async function run(motion, macroId, seconds) {
  if (!(await motion.run("macro", macroId, seconds)) && refusal.value)
    toast({ kind: "bad", title: safeText(refusal.value) });
}

/**
 * Show a message if the button on the board differs from the draft: the robot does what is written there.
 * @param {number} id
 */
function sayUnwritten(id) {
  const [now, then] = [draft.value, stored.value].map((each) =>
    JSON.stringify(buttonOf(each ? shownTable(each) : undefined, id)),
  );
  if (now !== then) toast({ icon: "info", title: t("buttons.unwritten"), detail: t("buttons.unwritten_detail") });
}

/** @param {Project} project */
function shownTable(project) {
  const tables = project.joystick_tables,
    id = chosenTable.value ?? project.active_joystick_table;
  return tables.find((table) => table.table_id === id) ?? tables[0];
}

/**
 * Return the macro that the board starts by itself after an event.
 * @param {number} id
 * @param {string} kind
 */
function startedBy(id, kind) {
  const { active_joystick_table: active = null, joystick_tables: tables = [] } = stored.value ?? {};
  const button = buttonOf(
    tables.find((table) => table.table_id === active),
    id,
  );
  if (kind === "press") return button.button_press_macro;
  return kind === "long_press" ? button.button_long_press_macro : kind === "up" ? button.button_up_macro : 0;
}

// Events of the buttons of the board, the newest first, and the number of lost ones.

const SHOWN = 4;

/** @type {Record<string, Key>} */
const TITLES = { press: "buttons.press", long_press: "buttons.long_press", up: "buttons.up" };

function EventCount() {
  const { heard: count, lost } = counts.value;
  if (count === 0) return html`<span class="mut">${t("buttons.no_events")}</span>`;
  if (lost > 0) return html`<span class="chip warn num">${t("buttons.events_lost", { count, lost })}</span>`;
  return html`<span class="mut num">${t("buttons.events", { count })}</span>`;
}

/** @param {{ macroOf: (id: number, kind: string) => string }} props */
function EventLog({ macroOf }) {
  const shown = heard.value.slice(0, SHOWN);
  return html`<div class="pad0">
    <h2 class="h3">${t("buttons.log")}</h2>
    <div role="log"><ul class="log">
      ${shown.map(({ number, id, kind, time }) => {
        const macro = macroOf(id, kind);
        return html`<li key=${number}>
          <time>${time.toTimeString().slice(0, 8)}</time><span class="sid acc">${id}</span>
          <span>${kind in TITLES ? t(TITLES[kind]) : kind}</span><span class="grow mut ell">${macro && `→ ${macro}`}</span>
        </li>`;
      })}
      ${shown.length === 0 && html`<li class="mut">${t("buttons.log_empty")}</li>`}
    </ul></div>
  </div>`;
}
