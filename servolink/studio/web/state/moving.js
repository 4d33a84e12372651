// Change to another board: the page begins anew, because all that it knows belongs to the board before.

import { effect } from "../html.js";
import { releasePorts } from "../link/worker-line.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { keepAddress } from "./connecting.js";
import { welcome } from "./robot.js";
import { forWindow } from "./storage.js";
import { toast } from "./toasts.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ by: string, left: string, is_stopped: boolean }} Moving */

const KEY = "servolink.moving";
const TAUGHT = ["servolink.taught", "servolink.taught_name"]; // poses and name on the screen Teach, of one robot
const LASTS = 12_000; // milliseconds

/**
 * Load the page again when the studio goes on to another board, and then say so.
 * @param {Link} link
 */
export function followMoves(link) {
  link.on("studio.moving", (notice) => void forWindow.set(KEY, JSON.stringify(notice)));
  link.onMoved = (left, next, url) => {
    keepTaught(left, next);
    keepAddress(url);
    releasePorts();
    location.reload();
  };
  effect(() => void (welcome.value && say(welcome.value.name)));
}

/**
 * Put poses and name of one robot aside, and bring back those of the other.
 * @param {string} left
 * @param {string} next
 */
function keepTaught(left, next) {
  for (const key of TAUGHT) {
    forWindow.set(`${key}.${left}`, forWindow.get(key) ?? "null");
    forWindow.set(key, forWindow.get(`${key}.${next}`) ?? "null");
  }
}

/**
 * Say that the board has changed, if it has.
 * @param {string} now name of the board
 */
function say(now) {
  const kept = forWindow.get(KEY);
  if (kept === null) return;
  forWindow.remove(KEY);
  /** @type {Moving} */
  const { by, left, is_stopped } = JSON.parse(kept);
  const title = now === "" ? t("robots.left", { name: safeText(left) }) : t("robots.now", { name: safeText(now) });
  const unsure = is_stopped ? "" : t("robots.not_stopped", { name: safeText(left) });
  const detail = unsure || (by === "" ? "" : t("robots.changed_by", { who: safeText(by) }));
  toast({ kind: is_stopped ? "ok" : "bad", title, detail, lasts: LASTS });
}
