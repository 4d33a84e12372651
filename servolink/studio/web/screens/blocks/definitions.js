// The blocks, in the words of the document, and the list from which they are taken.

import { safeText } from "../../parts/safe-text.js";
import { made } from "../../state/blocks.js";
import { nameOf } from "../../state/figure.js";
import { draft } from "../../state/project.js";
import { servoIds } from "../../state/robot.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../state/block-form.js").BlockType} BlockType */
/** @typedef {[string, string][]} Options */

const INSIDE = "DO";
const MOST = 1e12; // beyond every range of a board: the compiler says which range it is

/**
 * Define all blocks in the language of the page.
 * @param {any} Blockly
 */
export function defineBlocks(Blockly) {
  if (!Blockly.registry.hasItem(Blockly.registry.Type.FIELD, "record")) registerField(Blockly);
  for (const [type, block] of Object.entries(definitions()))
    Blockly.Blocks[type] = {
      /** @this {any} */
      init() {
        this.jsonInit(block);
      },
    };
}

/**
 * Register a field with a list. A value missing in the list is kept, such as the id of a deleted macro.
 * @param {any} Blockly
 */
function registerField(Blockly) {
  class RecordField extends Blockly.FieldDropdown {
    /** @param {unknown} value */
    doClassValidation_(value) {
      return typeof value === "string" ? value : null;
    }

    /** @param {boolean} [useCache] */
    getOptions(useCache) {
      const options = super.getOptions(useCache),
        value = this.getValue();
      const isKnown = value === null || options.some((/** @type {Options[0]} */ [, each]) => each === value);
      return isKnown ? options : [...options, [t("blocks.missing"), value]];
    }

    /** Return the present name, which may have changed since the record was chosen. */
    getText_() {
      return this.getOptions(false).find((/** @type {Options[0]} */ [, value]) => value === this.getValue())?.[0] ?? "";
    }
  }
  Blockly.fieldRegistry.register("record", RecordField);
}

/**
 * Return the description of each block in the form of Blockly.
 * @returns {Record<BlockType, object>}
 */
function definitions() {
  const caption = { type: "field_input", name: "caption", spellcheck: false };
  const servo = { type: "record", name: "servo_id", options: servoOptions };
  const degree = { type: "field_number", name: "degree", value: 0, precision: 1 };
  const ratio = { type: "field_number", name: "ratio_percent", value: 100, precision: 1 };
  const inside = (/** @type {string} */ check) => ({
    message1: "%1",
    args1: [{ type: "input_statement", name: INSIDE, check }],
  });
  const row = (/** @type {string} */ family) => ({ previousStatement: family, nextStatement: family });
  return {
    macro: {
      message0: t("blocks.macro"),
      args0: [{ ...caption, text: t("blocks.macro_name") }],
      ...inside("command"),
      style: "start_blocks",
    },
    button: {
      message0: t("blocks.button"),
      args0: [
        { type: "field_number", name: "button_id", value: 1, precision: 1 },
        {
          type: "field_dropdown",
          name: "event",
          options: [
            [t("blocks.press"), "press"],
            [t("blocks.long_press"), "long_press"],
            [t("blocks.up"), "up"],
          ],
        },
      ],
      ...inside("command"),
      style: "start_blocks",
    },
    pose: {
      message0: t("blocks.pose"),
      args0: [{ ...caption, text: t("blocks.pose_name") }, seconds("interval_ms")],
      ...inside("servo"),
      ...row("command"),
      style: "pose_blocks",
    },
    servo: { message0: t("blocks.servo"), args0: [servo, degree], ...row("servo"), style: "servo_blocks" },
    run_action: {
      message0: t("blocks.run_action"),
      args0: [{ type: "record", name: "target", options: actionOptions }, ratio],
      ...row("command"),
      style: "command_blocks",
    },
    run_macro: {
      message0: t("blocks.run_macro"),
      args0: [{ type: "record", name: "target", options: macroOptions }, ratio],
      ...row("command"),
      style: "command_blocks",
    },
    wait: { message0: t("blocks.wait"), args0: [seconds("delay_ms")], ...row("command"), style: "command_blocks" },
    repeat: {
      message0: t("blocks.repeat"),
      args0: [{ type: "field_number", name: "loop", value: 2, precision: 1 }],
      ...inside("command"),
      ...row("command"),
      style: "control_blocks",
    },
    forever: { message0: t("blocks.forever"), ...inside("command"), ...row("command"), style: "refused_blocks" },
    if: {
      message0: t("blocks.if"),
      args0: [servo, degree],
      ...inside("command"),
      ...row("command"),
      style: "refused_blocks",
    },
  };
}

/**
 * Return a field for seconds, in thousandths.
 * @param {string} name
 */
const seconds = (name) => ({ type: "field_number", name, value: 1, precision: 0.001, min: -MOST, max: MOST });

/**
 * Return the servos of the robot by name; servo 1 for a board without servos, as a list cannot be empty.
 * @returns {Options}
 */
const servoOptions = () => {
  const ids = servoIds.value.length > 0 ? servoIds.value : [1];
  return ids.map((id) => [nameOf(id), String(id)]);
};

/**
 * Return the actions to run: actions of the draft, and poses among the blocks.
 * @this {any}
 */
function actionOptions() {
  const ours = new Set(made.value.filter(({ kind }) => kind === "actions").map(({ id }) => id));
  const stored = (draft.value?.actions ?? []).filter(({ action_id }) => !ours.has(action_id));
  return optionsOf(
    this,
    "pose",
    stored.map((one) => [safeText(one.action_caption), `action ${one.action_id}`]),
  );
}

/**
 * Return the macros to run: macros of the draft, and macros among the blocks.
 * @this {any}
 */
function macroOptions() {
  const ours = new Set(made.value.filter(({ kind }) => kind !== "actions").map(({ id }) => id));
  const stored = (draft.value?.macros ?? []).filter(({ macro_id }) => !ours.has(macro_id));
  return optionsOf(
    this,
    "macro",
    stored.map((one) => [safeText(one.macro_caption), `macro ${one.macro_id}`]),
  );
}

/**
 * Return the options of a field: an empty choice, blocks of a type, and stored records.
 * @param {any} field
 * @param {BlockType} type
 * @param {Options} stored
 * @returns {Options}
 */
function optionsOf(field, type, stored) {
  const space = field.getSourceBlock?.()?.workspace;
  const blocks = (space?.targetWorkspace ?? space)?.getBlocksByType(type, true) ?? [];
  const ours = blocks.map((/** @type {any} */ block) => [
    safeText(block.getFieldValue("caption")),
    `block ${block.id}`,
  ]);
  return [
    [t("blocks.choose"), ""],
    ...ours,
    ...stored.map(([label, value]) => /** @type {[string, string]} */ ([label || value, value])),
  ];
}

/** Return the list from which blocks are taken. */
export const toolbox = () => ({
  kind: "categoryToolbox",
  contents: [
    category(t("blocks.list_start"), "start", [{ type: "macro" }, { type: "button" }]),
    category(t("blocks.list_poses"), "pose", [
      { type: "pose", inputs: { [INSIDE]: { block: { type: "servo" } } } },
      { type: "servo" },
    ]),
    category(t("blocks.list_commands"), "command", [
      { type: "run_action" },
      { type: "run_macro" },
      { type: "wait" },
      { type: "repeat" },
    ]),
    category(t("blocks.list_refused"), "refused", [{ type: "forever" }, { type: "if" }]),
  ],
});

/**
 * Return a category of the list with a colour of the theme.
 * @param {string} name
 * @param {string} style
 * @param {object[]} blocks
 */
const category = (name, style, blocks) => ({
  kind: "category",
  name,
  categorystyle: `${style}_category`,
  contents: blocks.map((block) => ({ kind: "block", ...block })),
});
