// Motions of another robot in a project: servos matched by name, mirrored and retimed if asked, before anything changes.

import { LONGEST, fitCaption, freeId, withRecord } from "./records.js";
import { mirrored } from "./mirror.js";

/** @typedef {import("./clipboard.js").Motions} Motions */
/** @typedef {import("./clipboard.js").NamedServo} NamedServo */
/** @typedef {import("./mirror.js").Mirror} Mirror */
/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Command} Command */
/** @typedef {import("./records.js").Step} Step */
/** Servo of this robot for each servo of the other, null for none. @typedef {Map<number, number | null>} Pairs */
/** The times of the motions become `percent` of what they were. @typedef {{ pairs: Pairs, mirror: Mirror | null, percent: number }} Fit */
/** Project after pasting; `left` are names of records of which no step is left. @typedef {{ project: Project, actions: number, macros: number, left: string[] }} Pasted */

const UNIT = 10; // milliseconds that the board counts

/**
 * Return the servos of this robot that have the name of a servo of another robot: its caption, the part of the figure
 * that it turns, or, if neither has a name, its id.
 * @param {readonly NamedServo[]} theirs
 * @param {readonly NamedServo[]} ours
 * @returns {Pairs}
 */
export function pairsOf(theirs, ours) {
  /** @type {Pairs} */
  const pairs = new Map(theirs.map(({ id }) => [id, null]));
  const free = new Set(ours);
  /** @param {(servo: NamedServo) => string} nameOf */
  const match = (nameOf) => {
    for (const servo of theirs.filter(({ id }) => pairs.get(id) === null)) {
      const name = nameOf(servo);
      const found = [...free].filter((each) => nameOf(each) === name);
      const isOne = theirs.filter((each) => nameOf(each) === name).length === 1;
      if (name === "" || found.length !== 1 || !isOne) continue;
      pairs.set(servo.id, found[0].id);
      free.delete(found[0]);
    }
  };
  match(({ caption }) => caption.toLowerCase().split(/\s+/u).filter(Boolean).join(" "));
  match(({ part }) => part);
  match(({ id, caption, part }) => (caption === "" && part === "" ? String(id) : ""));
  return pairs;
}

/**
 * Return the project with the motions. An action that the project has already is used as it is.
 * @param {Project} before
 * @param {Motions} motions
 * @param {Fit} fit
 * @returns {Pasted}
 */
export function pasted(before, motions, { pairs, mirror, percent }) {
  let project = before;
  /** @type {Map<number, number>} */
  const actionIds = new Map();
  /** @type {Map<number, number>} */
  const macroIds = new Map();
  /** @type {string[]} */
  const left = [];
  const retimed = (/** @type {number} */ time, /** @type {number} */ most) =>
    Math.min(most, Math.round((time * percent) / 100 / UNIT) * UNIT);
  for (const { action_id, action_caption, steps } of motions.actions) {
    const fitted = paired(steps, pairs).map((step) => ({ ...step, interval_ms: retimed(step.interval_ms, LONGEST) }));
    const ours = mirror ? mirrored(fitted, mirror) : fitted;
    const sorted = ours.sort((a, b) => a.servo_id - b.servo_id);
    if (sorted.length === 0) left.push(action_caption || String(action_id));
    else {
      const same = project.actions.find((each) => each.action_caption === action_caption && isSame(each.steps, sorted));
      const id = same?.action_id ?? freeId("actions", project);
      actionIds.set(action_id, id);
      if (same) continue;
      const caption = freeCaption(action_caption, project.actions.map((each) => each.action_caption)); // prettier-ignore
      project = withRecord(project, "actions", { action_id: id, action_caption: caption, steps: sorted });
    }
  }
  let macros = project.macros.map(({ macro_id }) => ({ macro_id })); // ids that are taken, before the macros are made
  for (const { macro_id } of motions.macros) {
    const id = freeId("macros", { ...project, macros: /** @type {any} */ (macros) });
    macros = [...macros, { macro_id: id }];
    macroIds.set(macro_id, id);
  }
  for (const { macro_id, macro_caption, commands } of motions.macros) {
    const ours = commands.flatMap((command) => commandFor(command, actionIds, macroIds) ?? []).map((command) =>
      command.delay_ms === undefined ? command : { ...command, delay_ms: retimed(command.delay_ms, 0x7fff_ffff) },
    ); // prettier-ignore
    const caption = freeCaption(macro_caption, project.macros.map((each) => each.macro_caption)); // prettier-ignore
    const record = { macro_id: macroIds.get(macro_id) ?? 0, macro_caption: caption, commands: ours };
    project = withRecord(project, "macros", record);
  }
  const added = project.actions.length - before.actions.length;
  return { project, actions: added, macros: motions.macros.length, left };
}

/**
 * Return the steps of the servos that have a partner; of two servos with the same partner, the first counts.
 * @param {readonly Step[]} steps
 * @param {Pairs} pairs
 * @returns {Step[]}
 */
function paired(steps, pairs) {
  /** @type {Map<number, number>} */
  const owner = new Map();
  return steps.flatMap((step) => {
    const ours = pairs.get(step.servo_id) ?? null;
    if (ours === null || (owner.get(ours) ?? step.servo_id) !== step.servo_id) return [];
    owner.set(ours, step.servo_id);
    return [{ ...step, servo_id: ours }];
  });
}

/**
 * @param {Command} command
 * @param {Map<number, number>} actionIds
 * @param {Map<number, number>} macroIds
 * @returns {Command | null}
 */
function commandFor(command, actionIds, macroIds) {
  if (command.type === "delay") return command;
  const isAction = command.type === "action",
    id = isAction ? actionIds.get(command.action_id ?? 0) : macroIds.get(command.macro_id ?? 0);
  if (id === undefined) return null;
  return isAction ? { ...command, action_id: id } : { ...command, macro_id: id };
}

/**
 * Return a caption that no other record has, with a number behind it if needed.
 * @param {string} caption
 * @param {readonly string[]} taken
 */
function freeCaption(caption, taken) {
  let found = caption;
  for (let number = 2; found !== "" && taken.includes(found); number++) {
    const end = ` ${number}`;
    let start = caption;
    while (fitCaption(start + end) !== start + end) start = [...start].slice(0, -1).join("");
    found = start + end;
  }
  return found;
}

/**
 * @param {unknown} one
 * @param {unknown} other
 */
const isSame = (one, other) => JSON.stringify(one) === JSON.stringify(other);
