// Actions and macros as text for the clipboard: JSON with the names of their servos, so that another robot can take them.

import { targetOf } from "./records.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Action} Action */
/** @typedef {import("./records.js").Macro} Macro */
/** Servo with its caption, and the part of the figure that it turns; both may be empty. @typedef {{ id: number, caption: string, part: string }} NamedServo */

/**
 * Return an action or a macro as text, with everything that it runs.
 * @param {Project} project
 * @param {"action" | "macro"} type
 * @param {number} id
 * @param {readonly NamedServo[]} servos of the robot
 */
export function copiedText(project, type, id, servos) {
  /** @type {Set<Action>} */
  const actions = new Set();
  /** @type {Map<number, Macro>} */
  const macros = new Map();
  /** @param {"action" | "macro"} kind @param {number} wanted */
  const add = (kind, wanted) => {
    const action = kind === "action" && project.actions.find((each) => each.action_id === wanted),
      macro = kind === "macro" && project.macros.find((each) => each.macro_id === wanted);
    if (action) actions.add(action);
    if (!macro || macros.has(wanted)) return;
    const commands = macro.commands.filter((command) => command.type !== "other"); // unknown to other boards
    macros.set(wanted, { ...macro, commands });
    for (const command of commands)
      if (command.type === "action" || command.type === "macro") add(command.type, targetOf(command));
  };
  add(type, id);
  const used = new Set([...actions].flatMap(({ steps }) => steps.map((step) => step.servo_id)));
  const named = [...used].map(
    (servo) => servos.find((each) => each.id === servo) ?? { id: servo, caption: "", part: "" },
  );
  const motions = { servos: named, actions: [...actions], macros: [...macros.values()] };
  return JSON.stringify({ kind: "servolink motions", version: 1, ...motions });
}
