// STOP at the edge of the page, and in each dialog at the same place.

import { createContext, html, useContext } from "../html.js";
import { shownScreen, stopFleet } from "../state/fleet.js";
import { hasBoard, hasFleet, sharesBoards } from "../state/robot.js";
import { toast } from "../state/toasts.js";
import { list, t } from "../texts/text.js";
import { safeText } from "./safe-text.js";

/** @typedef {import("../shell/app.js").Tools} Tools */

const DANGER_LASTS = 30_000; // milliseconds of a message about robots that may move

/** Connection and motion of the page, for STOP. */
export const StopTools = createContext(/** @type {Tools} */ ({}));

/** Button STOP; empty without a robot. Dialogs have a STOP too, as an open dialog makes the page inert. */
export function StopButton() {
  const tools = useContext(StopTools),
    stopsAll = stopsFleet();
  if (!hasBoard.value && !hasFleet.value && !sharesBoards.value) return null;
  return html`<button class="stop" aria-label=${t(stopsAll ? "stop.all_aria" : "stop.aria")} onClick=${() => stop(tools)}>
    <i aria-hidden="true"></i>${t(stopsAll ? "stop.all" : "stop.label")} <kbd class="hide-t hide-n">Esc</kbd>
  </button>`;
}

/** Return whether STOP stops the boards of the fleet too: they are on the screen, or there is no other board. */
export const stopsFleet = () => hasFleet.value && (shownScreen.value === "fleet" || !hasBoard.value);

/**
 * Stop the robot, on the screen of the fleet all robots, and say whether that was confirmed.
 * @param {Tools} tools
 */
export async function stop({ link, motion }) {
  if (stopsFleet()) stopAll(link);
  if (!hasBoard.value && !sharesBoards.value) return;
  try {
    await (hasBoard.value ? motion.stop() : link.call("studio.stop"));
  } catch (error) {
    toast({ kind: "bad", title: t("stop.failed"), detail: error instanceof Error ? error.message : "" });
    return;
  }
  toast({ kind: "ok", title: t("stop.done") });
}

/** @param {import("../link/link.js").Link} link */
async function stopAll(link) {
  toast({ name: "stop all", title: t("stop.sent") });
  try {
    const { stopped, failed, silent, offline } = await stopFleet(link),
      moving = [...Object.keys(failed), ...silent];
    if (moving.length > 0)
      toast({
        name: "may move",
        kind: "bad",
        title: t("stop.may_move", { boards: list(moving) }),
        lasts: DANGER_LASTS,
      });
    const detail = offline.length > 0 ? t("stop.offline", { boards: list(offline) }) : "";
    if (moving.length === 0 || stopped.length > 0)
      toast({ name: "stop all", kind: "ok", title: t("stop.all_done", { count: stopped.length }), detail });
  } catch (error) {
    const detail = error instanceof Error ? safeText(error.message) : "";
    toast({ name: "stop all", kind: "bad", title: t("stop.failed"), detail, lasts: DANGER_LASTS });
  }
}
