// Macro made of poses from the library: an action for each pose, and a macro to play the actions.

import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { namesOf } from "./film.js";
import { ask } from "./library.js";
import { draft, edit } from "./project.js";
import { fitCaption, withMade } from "./records.js";
import { editToast, toast } from "./toasts.js";
import { chooseAction, chooseMacro } from "./view.js";

/** @typedef {{ poses: { degrees: Record<string, number>, seconds: number }[], worst: number, size_bytes: number }} FewPoses */

/** @type {FewPoses} */
export const NO_POSES = { poses: [], worst: 0, size_bytes: 0 };

/**
 * Add actions of poses to the draft, and a macro to play the actions.
 * @param {string} name
 * @param {FewPoses["poses"]} poses
 * @param {"easing.did_make" | "seen.did_make"} label
 * @returns {Promise<boolean>} whether they were added
 */
export async function makeMacro(name, poses, label) {
  const project = draft.value;
  let fitting = name;
  while (fitCaption(`${fitting} ${poses.length}`) !== `${fitting} ${poses.length}`)
    fitting = [...fitting].slice(0, -1).join("");
  const question = { ...namesOf(fitting, project), poses, start: {}, caps: {}, may_repeat: true };
  try {
    const made = await ask("project.lesson", question);
    if (draft.value !== project) return makeMacro(name, poses, label); // other ids are free now
    edit([label, { name }], (before) => withMade(before, made));
    chooseAction(made.actions[0].action_id);
    if (made.macros.length > 0) chooseMacro(made.macros[0].macro_id);
    editToast({ title: t("easing.made", { name }), detail: t("easing.made_detail") });
    return true;
  } catch (error) {
    const detail = error instanceof Error ? safeText(error.message) : "";
    toast({ kind: "bad", title: t("note.problem"), detail });
    return false;
  }
}
