// The workspace of Blockly: shows a program, reports changes, and marks refused blocks.

import { fromBlockly, MOST_BLOCKS, toBlockly } from "../../state/block-form.js";
import { t } from "../../texts/text.js";
import { defineBlocks, toolbox } from "./definitions.js";

/** @typedef {import("../../state/block-form.js").Stack} Stack */
/** @typedef {import("../../state/block-compiler.js").Problem} Problem */

/** Types of blocks with a name that becomes the caption of a record. */
const NAMED = ["macro", "pose"];
/** Types of blocks with a list of records to run. */
const RUNS = ["run_action", "run_macro"];
/** Zoom of the workspace: buttons and two fingers, as the wheel scrolls. */
const SCALE = { startScale: 0.8, minScale: 0.4, maxScale: 1.6, controls: true, pinch: true, wheel: false };

/** Workspace of Blockly in an element of the page, until it is closed. */
export class Workspace {
  /**
   * @param {any} Blockly
   * @param {HTMLElement} place
   * @param {boolean} isReadOnly
   * @param {(stacks: Stack[]) => void} onChange
   */
  constructor(Blockly, place, isReadOnly, onChange) {
    this._Blockly = Blockly;
    this._onChange = onChange;
    /** The stacks that are shown, as JSON; empty before the first stacks. */
    this._shown = "";
    /** Events of blocks that were taken from the list or copied. @type {any[]} */
    this._created = [];
    defineBlocks(Blockly);
    this._space = Blockly.inject(place, {
      toolbox: toolbox(),
      renderer: "studio",
      theme: "studio",
      media: "/vendor/blockly/",
      css: false,
      sounds: false,
      modalInputs: false, // a prompt of the browser would cover STOP
      collapse: false,
      comments: false,
      disable: false,
      maxBlocks: MOST_BLOCKS,
      readOnly: isReadOnly,
      zoom: SCALE,
    });
    this._space.addChangeListener((/** @type {any} */ event) => this._changed(event));
    this._size = new ResizeObserver(() => Blockly.svgResize(this._space));
    this._size.observe(place);
    this._leaving = () => this._report();
    addEventListener("pagehide", this._leaving);
  }

  /** Report the last changes, and take the workspace out of the page. */
  close() {
    this._report();
    removeEventListener("pagehide", this._leaving);
    this._size.disconnect();
    this._space.dispose();
  }

  /**
   * Show stacks, unless the same stacks are shown already. Throws an error of Blockly for impossible stacks.
   * @param {readonly Stack[]} stacks
   */
  show(stacks) {
    const text = JSON.stringify(stacks);
    if (text === this._shown) return;
    this._shown = text;
    this._Blockly.serialization.workspaces.load(toBlockly({ blocks: 1, stacks, made: [] }), this._space);
    this._space.clearUndo();
  }

  /**
   * Write the reasons on the refused blocks, and take them off all others. Return the names of the refused blocks.
   * @param {readonly Problem[]} problems
   * @returns {Map<string, string>}
   */
  mark(problems) {
    const texts = new Map(problems.map(({ block, reason, values }) => [block, t(reason, values)]));
    for (const block of this._space.getAllBlocks(false)) block.setWarningText(texts.get(block.id) ?? null);
    return new Map([...texts.keys()].map((id) => [id, this._nameOf(id)]));
  }

  /**
   * Return the words of a block without the blocks inside.
   * @param {string} id
   * @returns {string}
   */
  _nameOf(id) {
    const inputs = this._space.getBlockById(id)?.inputList ?? [];
    return inputs
      .flatMap((/** @type {any} */ input) => input.fieldRow)
      .map((/** @type {any} */ field) => field.getText())
      .join(" ");
  }

  /**
   * Bring a block into view, and choose it.
   * @param {string} id
   */
  choose(id) {
    const block = this._space.getBlockById(id);
    if (block === null) return;
    this._space.centerOnBlock(id);
    this._Blockly.getFocusManager().focusNode(block);
  }

  /**
   * Undo the latest change of the blocks, or redo the change that was undone last.
   * @param {boolean} isRedo
   */
  undo(isRedo) {
    this._space.undo(isRedo);
  }

  /**
   * Add a pose block.
   * @param {import("../../figure/figure.js").Pose} pose
   */
  addPose(pose) {
    const { viewLeft, viewTop } = this._view();
    const blocks = Object.entries(pose).map(([id, degree]) => ({
      type: /** @type {const} */ ("servo"),
      id: this._Blockly.utils.idGenerator.genUid(),
      servo_id: Number(id),
      degree: Math.round(degree),
    }));
    const id = this._Blockly.utils.idGenerator.genUid();
    const block = {
      type: /** @type {const} */ ("pose"),
      id,
      caption: t("blocks.pose_name"),
      interval_ms: 1000,
      blocks,
    };
    const stack = { x: viewLeft + 40, y: viewTop + 40, blocks: [block] };
    const [saved] = toBlockly({ blocks: 1, stacks: [stack], made: [] }).blocks.blocks;
    this._Blockly.serialization.blocks.append(saved, this._space, { recordUndo: true });
    this.choose(id);
  }

  /** Return the upper left corner of the visible part, in the units of blocks. */
  _view() {
    const { viewLeft, viewTop } = this._space.getMetrics();
    return { viewLeft: viewLeft / this._space.scale, viewTop: viewTop / this._space.scale };
  }

  /**
   * Report the stacks after a change that is complete: not while a block is dragged.
   * @param {any} event
   */
  _changed(event) {
    const { Events } = this._Blockly;
    if (event.type === Events.TOOLBOX_ITEM_SELECT) this._hideConnections();
    const isDropped = event.type === Events.BLOCK_DRAG && !event.isStart;
    if (isDropped) Events.setGroup(false); // Blockly forgets to after a move by keyboard
    if (event.type === Events.BLOCK_CREATE && event.recordUndo) this._created.push(event);
    if ((event.isUiEvent && !isDropped) || event.type === Events.FINISHED_LOADING || this._space.isDragging()) return;
    for (const created of this._created.splice(0)) this._nameApart(created);
    if (event.name === "caption")
      for (const type of RUNS)
        for (const block of this._space.getBlocksByType(type)) block.getField("target").forceRerender();
    this._report();
  }

  /** Report changed stacks. Blockly reports a change a frame later: too late if the page is left. */
  _report() {
    if (this._shown === "" || this._space.isDragging()) return;
    const stacks = fromBlockly(this._Blockly.serialization.workspaces.save(this._space));
    const text = JSON.stringify(stacks);
    if (text === this._shown) return;
    this._shown = text;
    this._onChange(stacks);
  }

  /** Hide the connections of the blocks in the open list from screen readers: a list box has options only. */
  _hideConnections() {
    const canvas = this._space.getFlyout()?.getWorkspace().getCanvas();
    for (const path of canvas?.querySelectorAll("[role=figure]") ?? []) path.setAttribute("aria-hidden", "true");
  }

  /**
   * Give new blocks names of their own: a copied pose is another pose.
   * @param {any} event
   */
  _nameApart({ ids = [], group }) {
    const { Events } = this._Blockly;
    const before = Events.getGroup();
    Events.setGroup(group);
    for (const id of ids) {
      const block = this._space.getBlockById(id);
      if (!NAMED.includes(block?.type)) continue;
      const taken = this._space
        .getBlocksByType(block.type)
        .filter((/** @type {any} */ other) => other !== block)
        .map((/** @type {any} */ other) => other.getFieldValue("caption"));
      const name = block.getFieldValue("caption"),
        base = name.replace(/ \d+$/, "");
      let number = 2;
      if (taken.includes(name)) {
        while (taken.includes(`${base} ${number}`)) number++;
        block.setFieldValue(`${base} ${number}`, "caption");
      }
    }
    Events.setGroup(before);
  }
}
