// Motions of a page without a server: a killed browser sends no stop. So single motions at its port are short, and what
// lasts on the board begins after a yes of a person.

import { computed } from "../html.js";
import { t } from "../texts/text.js";
import { isInPage } from "./connecting.js";
import { servos, welcome } from "./robot.js";
import { toast } from "./toasts.js";

/** @typedef {import("./motion.js").Part} Part */

const LONGEST = 2; // seconds of a single motion
const USUAL = 1.5; // seconds of one piece of a longer motion; rounded angles may need a little more
const SHOWN = 20_000; // milliseconds of the question

/** Whether motions would run on after the end of the browser. */
const runsOn = computed(() => isInPage && welcome.value?.is_virtual === false);
let isAgreed = false;

/** Return movements of at most 2 s that do the same as `parts`, if the robot is at a port of the page. @param {Part[]} parts @returns {Part[]} */
export function shortened(parts) {
  if (!runsOn.value) return parts;
  const here = Object.fromEntries([...servos.value].map(([id, { angle }]) => [id, angle]));
  const pieces = parts.flatMap((part, index) => {
    const from = { ...here };
    Object.assign(here, part.targets);
    // Once a later part has begun to turn a servo, the earlier one turns it no more.
    const later = parts.slice(index + 1);
    /** @param {string} id @param {number} at */
    const isOver = (id, at) => later.some((next) => next.at <= at && id in next.targets);
    return piecesOf(part, from).map((piece) => ({
      ...piece,
      targets: Object.fromEntries(
        Object.entries(piece.targets).filter(([id]) => piece.at === part.at || !isOver(id, piece.at)),
      ),
    }));
  });
  return pieces.sort((one, other) => one.at - other.at);
}

/** Return the pieces of a movement from angles, by servo; a piece is never faster than the whole. @param {Part} part @param {Record<string, number>} from @returns {Part[]} */
function piecesOf(part, from) {
  const { at, duration, targets } = part,
    count = duration <= LONGEST ? 1 : Math.ceil(duration / USUAL),
    ids = Object.keys(targets);
  if (count === 1 || ids.some((id) => !(id in from))) return [part];
  /** @param {string} id @param {number} done */
  const angle = (id, done) => Math.round(from[id] + (targets[Number(id)] - from[id]) * done);
  const pieces = [];
  let begin = at;
  for (let number = 1; number <= count; number++) {
    const before = (/** @type {string} */ id) => (number === 1 ? from[id] : angle(id, (number - 1) / count));
    const shares = ids.map(
      (id) => Math.abs(angle(id, number / count) - before(id)) / Math.abs(targets[Number(id)] - from[id] || 1),
    );
    const seconds = Math.min(LONGEST, Math.max(duration / count, ...shares.map((share) => share * duration)));
    pieces.push({
      at: begin,
      duration: seconds,
      targets: Object.fromEntries(ids.map((id) => [id, angle(id, number / count)])),
    });
    begin += seconds;
  }
  return pieces;
}

/** Begin what may last on the board; at a port of the page, after one yes. @param {() => void} begin */
export function beginLasting(begin) {
  if (!runsOn.value || isAgreed) return begin();
  const run = () => {
    isAgreed = true;
    begin();
  };
  const action = { label: t("run.lasting_yes"), run };
  return toast({
    name: "lasting",
    icon: "warn",
    title: t("run.lasting"),
    detail: t("run.lasting_detail"),
    lasts: SHOWN,
    action,
  });
}
