// Opening and saving project files: the same ones as those of the command line.

import { RequestError } from "../../link/link.js";
import { safeText } from "../../parts/safe-text.js";
import { saveBytes } from "../../parts/save-bytes.js";
import { blocksForFile, takeBlocks } from "../../state/blocks.js";
import { ownFigure, saveFigure } from "../../state/figure.js";
import { draft, edit } from "../../state/project.js";
import { isLocalEditor, welcome } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */

const MOST_BYTES = 1_000_000; // of one message to the studio

/**
 * Take the content of a file into the draft; what was there can be had back with undo.
 * @param {Link} link
 * @param {File} file
 */
export async function openFile(link, file) {
  const name = safeText(file.name);
  try {
    if (file.size > MOST_BYTES) throw new RangeError(t("project.too_large"));
    const text = await file.text();
    if (JSON.stringify(text).length > MOST_BYTES) throw new RangeError(t("project.too_large"));
    if (!isJson(text)) throw new RangeError(t("project.not_project"));
    const answer = await link.call("studio.file.read", { text }),
      { figure, blocks, ...project } = answer.project;
    if (figure) await takeFigure(link, figure);
    edit(["project.opened", { name }], (before) => ({ ...before, ...project }));
    if (blocks) await takeBlocks(link, blocks);
    toast({ kind: "ok", title: t("project.opened", { name }), detail: t("project.opened_detail") });
  } catch (error) {
    toast({ kind: "bad", title: t("project.not_opened", { name }), detail: messageOf(error) });
  }
}

/**
 * Take the figure of a file, unless the robot has another one: then the person is asked. Links leave the figure.
 * @param {Link} link
 * @param {import("../../state/figure.js").FigureData} figure
 */
async function takeFigure(link, figure) {
  if (!isLocalEditor.value || JSON.stringify(figure) === JSON.stringify(ownFigure.value)) return;
  const take = () => saveFigure(link, figure).catch((error) => toast({ kind: "bad", title: messageOf(error) }));
  if (ownFigure.value === null) return take();
  toast({
    title: t("figure.in_file"),
    detail: t("figure.in_file_detail"),
    action: { label: t("figure.take"), run: take },
  });
}

/**
 * Save the draft as a file.
 * @param {Link} link
 */
export async function saveFile(link) {
  try {
    const figure = ownFigure.value ?? undefined,
      blocks = await blocksForFile(link);
    const { text } = await link.call("studio.file.write", { project: { ...draft.value, figure, blocks } });
    saveBytes(`${(welcome.value?.name ?? "robot").replace(/[^\w-]/g, "_")}.servolink.json`, "application/json", [text]);
  } catch (error) {
    toast({ kind: "bad", title: t("project.not_saved"), detail: messageOf(error) });
  }
}

/** @param {string} text */
function isJson(text) {
  try {
    return typeof JSON.parse(text.replace(/^\uFEFF/, "")) === "object";
  } catch {
    return false;
  }
}

/** @param {unknown} error */
const messageOf = (error) =>
  safeText(error instanceof RequestError || error instanceof RangeError ? error.message : t("project.not_readable"));
