// Settings of the board: project id, memory, transmission mode, and the deletion of everything.

import { html } from "../../html.js";
import { AskButton } from "../../parts/ask-button.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { safeText } from "../../parts/safe-text.js";
import { clearBoard, progress } from "../../state/plan.js";
import { draft, edit, open, reading, stored } from "../../state/project.js";
import { isLive, isOthers, welcome } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { showScreen } from "../../state/view.js";
import { number, t } from "../../texts/text.js";
import { useAnswer } from "./asking.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {{ servo_ids: number[], project_id: number | null, is_unfinished: boolean, memory_free: number | null, memory_total: number | null }} Facts */

/** Highest project id below the ids that mark an unfinished import. */
const MOST_PROJECT = 0x7fff_ffff;

/** @param {{ link: Link }} props */
export function SettingsCard({ link }) {
  const { answer, error, isAsking, ask } = useAnswer(link, "board.facts", () => ({}));
  const facts = /** @type {Facts | null} */ (answer);
  if (welcome.value?.role !== "edit") return null;
  return html`<section class="card" aria-labelledby="settings-title">
    <header><h2 id="settings-title">${t("settings.title")}</h2>
      <button class="btn s" disabled=${isAsking || !isLive.value} onClick=${ask}>${t("settings.read")}</button>
    </header>
    <div class="pad0 stack">
      ${error && html`<${Note} kind="bad" title=${safeText(error)} />`}
      <dl class="kv">
        <dt>${t("settings.servo_ids")}</dt><dd class="num">${facts ? facts.servo_ids.join(", ") || "0" : "\u2013"}</dd>
        <dt>${t("settings.memory")}</dt><dd class="num">${memoryOf(facts)}</dd>
        <dt>${t("settings.project_id")}</dt><dd class="num">${projectOf(facts)}</dd>
      </dl>
      <${ProjectId} link=${link} />
      <${Mode} link=${link} />
      <${Clear} link=${link} />
    </div>
  </section>`;
}

/** @param {Facts | null} facts */
function memoryOf(facts) {
  if (facts === null) return "\u2013";
  if (facts.memory_free === null) return t("settings.not_measured");
  const free = number(facts.memory_free);
  if (facts.memory_total === null) return t("settings.free", { free });
  const text = t("settings.free_of", { free, total: number(facts.memory_total) });
  return facts.memory_free > facts.memory_total ? `${text} (${t("live.doubtful")})` : text;
}

/** @param {Facts | null} facts */
function projectOf(facts) {
  if (facts === null) return "\u2013";
  if (facts.is_unfinished) return t("settings.unfinished");
  return facts.project_id === null ? t("settings.unknown") : facts.project_id || t("settings.no_project");
}

/**
 * Field for another project id, which is written with the other edits.
 * @param {{ link: Link }} props
 */
function ProjectId({ link }) {
  const project = draft.value;
  if (project === null)
    return html`<div><button class="btn s" disabled=${!isLive.value || reading.value.state === "reading"} onClick=${() => open(link)}>
      ${t(reading.value.state === "reading" ? "project.reading" : "settings.change_project_id")}
    </button></div>`;
  /** @param {number} project_id */
  const change = (project_id) =>
    edit(["settings.did_project_id", { id: project_id }], (before) => ({ ...before, project_id }));
  const isEdited = project.project_id !== stored.value?.project_id;
  return html`<label class="field"><span>${t("settings.new_project_id")}</span>
      <${NumberField} label=${t("settings.new_project_id")} value=${project.project_id} format=${String} low=${0} high=${MOST_PROJECT} onChange=${change} />
    </label>
    ${isEdited && html`<p class="mut">${t("settings.written_later")} <a href="#project">${t("settings.to_write")}</a></p>`}`;
}

// The transmission mode. A board in mode 0 answers nothing, not even a stop, so there is a question before it.

/** @param {{ link: Link }} props */
function Mode({ link }) {
  /** @param {0 | 1} mode */
  const set = async (mode) => {
    try {
      await link.call("board.mode", { mode });
      toast({ kind: "ok", title: t("settings.mode_set", { mode }) });
    } catch (error) {
      toast({ kind: "bad", title: safeText(error instanceof Error ? error.message : "") });
    }
  };
  const isOff = !isLive.value || isOthers.value;
  const question = {
    title: t("settings.mode_ask"),
    detail: t("settings.mode_ask_detail"),
    yes: t("settings.mode_ask_yes"),
  };
  return html`<h3>${t("settings.mode")}</h3>
    <p class="mut">${t("settings.mode_detail")}</p>
    <div class="row wrap">
      <button class="btn s" disabled=${isOff} onClick=${() => set(1)}>${t("settings.mode_new")}</button>
      <${AskButton} disabled=${isOff} question=${question} onYes=${() => set(0)}>${t("settings.mode_old")}</${AskButton}>
    </div>`;
}

// Deletion of everything stored on the board, after a backup.

/** @param {{ link: Link }} props */
function Clear({ link }) {
  const clear = () => {
    clearBoard(link);
    location.hash = "project"; // shows the progress, and the way back
    showScreen("project");
  };
  const name = safeText(welcome.value?.name ?? ""),
    isOff = !isLive.value || isOthers.value || progress.value !== null;
  const question = {
    title: t("settings.clear_ask", { name }),
    detail: t("settings.clear_ask_detail"),
    sure: t("settings.clear_sure", { name }),
    yes: t("settings.clear_yes"),
  };
  return html`<h3>${t("settings.clear")}</h3>
    <p class="mut">${t("settings.clear_detail")}</p>
    <div><${AskButton} kind="danger" disabled=${isOff} question=${question} onYes=${clear}>${t("settings.clear_button")}</${AskButton}></div>`;
}
