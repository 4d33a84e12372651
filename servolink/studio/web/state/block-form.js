// Programs made of blocks: their form in project files, and the form that Blockly reads and writes.

/** @typedef {"macro" | "button" | "pose" | "servo" | "run_action" | "run_macro" | "wait" | "repeat" | "forever" | "if"} BlockType */
/**
 * A block; the type decides which of the other fields it has.
 * @typedef {object} Block
 * @property {BlockType} type
 * @property {string} id
 * @property {string} [caption]
 * @property {number} [button_id]
 * @property {"press" | "long_press" | "up"} [event]
 * @property {number} [interval_ms]
 * @property {number} [servo_id]
 * @property {number} [degree]
 * @property {string} [target] such as `action 3`, `macro 2` or `block x9`; empty for none
 * @property {number} [ratio_percent]
 * @property {number} [delay_ms]
 * @property {number} [loop]
 * @property {readonly Block[]} [blocks] inside
 */
/** Blocks that hang together, and their place. @typedef {{ x: number, y: number, blocks: readonly Block[] }} Stack */
/** Record made of blocks. @typedef {{ kind: "actions" | "macros" | "buttons", id: number, caption: string }} Made */
/** @typedef {{ blocks: 1, stacks: readonly Stack[], made: readonly Made[] }} Program */
/** Block as Blockly writes it. @typedef {{ type: string, id: string, x?: number, y?: number, fields?: Record<string, any>, inputs?: Record<string, { block: Saved }>, next?: { block: Saved } }} Saved */

/** Most blocks that the studio keeps. */
export const MOST_BLOCKS = 1000;
/** @type {Program} */
export const NO_BLOCKS = { blocks: 1, stacks: [], made: [] };
/** Name of the place inside a block. */
const INSIDE = "DO";

/** @typedef {"text" | "number" | "seconds" | "choice"} FieldKind */
/** Fields of each type of block, and whether it holds others. @type {Record<BlockType, { fields: Record<string, FieldKind>, holds: boolean }>} */
const FORMS = {
  macro: { fields: { caption: "text" }, holds: true },
  button: { fields: { button_id: "number", event: "text" }, holds: true },
  pose: { fields: { caption: "text", interval_ms: "seconds" }, holds: true },
  servo: { fields: { servo_id: "choice", degree: "number" }, holds: false },
  run_action: { fields: { target: "text", ratio_percent: "number" }, holds: false },
  run_macro: { fields: { target: "text", ratio_percent: "number" }, holds: false },
  wait: { fields: { delay_ms: "seconds" }, holds: false },
  repeat: { fields: { loop: "number" }, holds: true },
  forever: { fields: {}, holds: true },
  if: { fields: { servo_id: "choice", degree: "number" }, holds: true },
};

const TO_BLOCKLY = {
  text: (/** @type {string} */ value) => value,
  number: (/** @type {number} */ value) => value,
  seconds: (/** @type {number} */ value) => value / 1000,
  choice: String,
};
const FROM_BLOCKLY = {
  text: String,
  number: Number,
  seconds: (/** @type {number} */ value) => Math.round(Number(value) * 1000),
  choice: Number,
};

/**
 * Return a program as Blockly reads it.
 * @param {Program} program
 */
export const toBlockly = ({ stacks }) => ({
  blocks: { languageVersion: 0, blocks: stacks.map(({ x, y, blocks }) => ({ ...chainOf(blocks), x, y })) },
});

/**
 * Return blocks in a row as a chain, in which each block holds the next block.
 * @param {readonly Block[]} blocks at least one
 * @returns {Saved}
 */
function chainOf(blocks) {
  let next = /** @type {Saved | null} */ (null);
  for (const block of [...blocks].reverse()) {
    /** @type {any} */
    const { type, id, blocks: inner = [] } = block;
    const fields = Object.entries(FORMS[block.type].fields).map(([name, kind]) => [
      name,
      TO_BLOCKLY[kind](/** @type {any} */ (block)[name]),
    ]);
    next = {
      type,
      id,
      fields: Object.fromEntries(fields),
      ...(inner.length > 0 && { inputs: { [INSIDE]: { block: chainOf(inner) } } }),
      ...(next && { next: { block: next } }),
    };
  }
  return /** @type {Saved} */ (next);
}

/**
 * Return the stacks that Blockly has written.
 * @param {{ blocks?: { blocks: Saved[] } }} saved
 * @returns {Stack[]}
 */
export const fromBlockly = ({ blocks }) =>
  (blocks?.blocks ?? []).map((first) => ({
    x: Math.round(first.x ?? 0),
    y: Math.round(first.y ?? 0),
    blocks: listOf(first),
  }));

/**
 * Return the blocks of a chain as a list, without recursion along the chain.
 * @param {Saved | undefined} first
 * @returns {Block[]}
 */
function listOf(first) {
  const found = [];
  for (let each = first; each; each = each.next?.block) {
    const { type, id, fields = {}, inputs = {} } = each,
      form = FORMS[/** @type {BlockType} */ (type)];
    const values = Object.entries(form.fields).map(([name, kind]) => [name, FROM_BLOCKLY[kind](fields[name])]);
    const block = { type, id, ...Object.fromEntries(values) };
    found.push(/** @type {Block} */ (form.holds ? { ...block, blocks: listOf(inputs[INSIDE]?.block) } : block));
  }
  return found;
}

/**
 * Return all blocks of a program, the outer ones first.
 * @param {Pick<Program, "stacks">} program
 */
export function blocksOf({ stacks }) {
  const found = stacks.flatMap(({ blocks }) => blocks);
  for (const block of found) found.push(...(block.blocks ?? []));
  return found;
}
