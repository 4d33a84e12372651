// Blocks: programs put together with the mouse, a finger or the keyboard, which become actions, macros and buttons.

import { html, useEffect, useRef, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Reading } from "../../parts/reading.js";
import { changeStacks, compiled, makeRecords, openBlocks, program } from "../../state/blocks.js";
import { draft } from "../../state/project.js";
import { actualPose, isFresh, isLive, servoIds, welcome } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { language, t } from "../../texts/text.js";
import { loadBlockly } from "./blockly.js";
import { Result } from "./result.js";
import { Workspace } from "./workspace.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function BlocksScreen(tools) {
  useEffect(() => {
    if (isLive.value) openBlocks(tools.link);
  }, [isLive.value]);
  if (draft.value === null || program.value === null) return html`<${Reading} link=${tools.link} icon="blocks" />`;
  return html`<${Content} key=${language.value} />`;
}

/** Workspace and result, once the draft and the blocks are known. */
function Content() {
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  const [space, setSpace] = useState(/** @type {Workspace | null} */ (null));
  const [names, setNames] = useState(/** @type {ReadonlyMap<string, string>} */ (new Map()));
  const [state, setState] = useState(/** @type {"loading" | "ready" | "failed"} */ ("loading"));
  const mayEdit = welcome.value?.role === "edit";
  useEffect(() => {
    let isHere = true,
      made = /** @type {Workspace | null} */ (null);
    loadBlockly().then(
      (Blockly) => {
        if (!isHere || place.current === null) return;
        made = new Workspace(Blockly, place.current, !mayEdit, changeStacks);
        setSpace(made);
        setState("ready");
      },
      () => isHere && setState("failed"),
    );
    return () => {
      isHere = false;
      made?.close();
    };
  }, [mayEdit]);
  const stacks = program.value?.stacks,
    problems = compiled.value?.problems;
  useEffect(() => {
    if (space === null || stacks === undefined) return;
    try {
      space.show(stacks);
    } catch (error) {
      toast({ name: "blocks", kind: "bad", title: t("blocks.not_shown"), detail: String(error) });
    }
    setNames(space.mark(problems ?? []));
  }, [space, stacks, problems]);
  return html`<div class="blocks">
    <section class="card">
      <header class="wrap"><h1 class="grow">${t("screen.blocks")}</h1>
        ${mayEdit && html`<${Commands} space=${space} />`}
      </header>
      ${state !== "ready" && html`<p class="empty" role="status">${t(state === "failed" ? "blocks.failed" : "blocks.loading")} ${state === "failed" && t("blocks.failed_detail")}</p>`}
      <div class="blockspace" ref=${place}></div>
    </section>
    <${Result} space=${space} names=${names} onMake=${mayEdit ? makeRecords : null} />
  </div>`;
}

/**
 * Buttons above the blocks, for people who may edit.
 * @param {{ space: Workspace | null }} props
 */
function Commands({ space }) {
  const mayTake = space !== null && isFresh.value && servoIds.value.length > 0;
  return html`<button class="btn" disabled=${!mayTake} onClick=${() => space?.addPose(actualPose())}>
      <${Icon} name="camera" />${t("blocks.take_pose")}
    </button>
    <button class="btn ic" disabled=${space === null} aria-label=${t("blocks.undo")} title=${t("blocks.undo")} onClick=${() => space?.undo(false)}><${Icon} name="undo" /></button>
    <button class="btn ic" disabled=${space === null} aria-label=${t("blocks.redo")} title=${t("blocks.redo")} onClick=${() => space?.undo(true)}><${Icon} name="redo" /></button>`;
}
