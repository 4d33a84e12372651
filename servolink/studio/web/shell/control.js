// Control of the robot: the lease belongs to the page, to another program, or to nobody.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { safeText } from "../parts/safe-text.js";
import { drawLighter } from "../parts/stage.js";
import { isLive, isMine, isOthers, lease, linkState, mayMove } from "../state/robot.js";
import { toast } from "../state/toasts.js";
import { said } from "../texts/said.js";
import { t } from "../texts/text.js";

/** @typedef {import("./app.js").Tools} Tools */

const REMEDY_LASTS = 20_000; // milliseconds

/** @param {Tools} tools */
export function Control(tools) {
  if (linkState.value !== "open" || !mayMove.value) return null;
  if (isMine.value) {
    return html`<button class="btn mine hide-n" title=${t("lease.give")} onClick=${() => tools.motion.leave()}>
      <${Icon} name="hand" /><span class="hide-t">${t("lease.mine")}</span><span class="only-t">${t("lease.mine_short")}</span>
    </button>`;
  }
  if (!isOthers.value) return null;
  const who = safeText(said(lease.value?.who ?? ""));
  return html`<button class="btn hide-n" onClick=${() => ask(tools)}>
    <${Icon} name="lock" /><span class="ell">${t("lease.others", { who })}</span><b class="ask hide-t">${t("lease.ask")}</b>
  </button>`;
}

/**
 * Ask who moves the robot for control, and offer to take it over.
 * @param {Tools} tools
 */
export function ask({ link, motion }) {
  link.tell("lease.ask");
  const takeOver = async () => {
    if (await motion.begin({ force: true })) motion.end(); // from now on this page watches over the robot
  };
  toast({
    icon: "hand",
    title: t("lease.asked", { who: safeText(said(lease.value?.who ?? "")) }),
    detail: t("lease.asked_detail"),
    action: { label: t("lease.take_over"), run: takeOver },
  });
}

/**
 * Report changes of the lease of this page to the person.
 * @param {{ event: string, by: string | null }} notice
 * @param {boolean} wasMine
 * @param {import("../state/motion.js").Motion} motion
 */
export function sayLease({ event, by }, wasMine, motion) {
  if (!wasMine) return;
  const who = safeText(said(by ?? ""));
  if (event === "taken over") toast({ kind: "bad", icon: "lock", title: t("lease.taken_over", { who }) });
  if (event === "beats stopped" && isLive.value) {
    const detail = t(drawLighter() ? "lease.drawn_lighter" : "lease.make_room");
    toast({ kind: "bad", title: t("lease.beats_stopped"), detail, lasts: REMEDY_LASTS });
  }
  if (event === "asked for") {
    const give = { label: t("lease.give"), run: () => motion.leave() };
    toast({ icon: "hand", title: t("lease.asks", { who }), action: give });
  }
}
