// Undo and redo: steps of edits, each with a label that describes the edit.

import { computed, signal } from "../html.js";

/** @typedef {import("../texts/text.js").Key} Key */
/** Label of a step: a text and its values. @typedef {[Key, Record<string, string | number>?]} Label */
/**
 * @template V
 * @typedef {{ label: Label, merge: string, before: V, after: V }} Change
 */

const MOST = 300;

/** @template V */
export class UndoList {
  constructor() {
    this._past = signal(/** @type {Change<V>[]} */ ([]));
    this._future = signal(/** @type {Change<V>[]} */ ([]));
    /** Label of the step to undo next, null without one. */
    this.undoLabel = computed(() => this._past.value.at(-1)?.label ?? null);
    /** Label of the step to redo next, null without one. */
    this.redoLabel = computed(() => this._future.value.at(-1)?.label ?? null);
  }

  /**
   * Add a step. Steps with the same `merge`, one after the other, are one: the parts of a drag.
   * @param {Label} label
   * @param {V} before
   * @param {V} after
   * @param {string} merge
   */
  add(label, before, after, merge) {
    const past = this._past.value,
      last = past.at(-1);
    const isPart = merge !== "" && last?.merge === merge;
    const step = { label, merge, before: isPart ? last.before : before, after };
    this._past.value = [...(isPart ? past.slice(0, -1) : past), step].slice(-MOST);
    this._future.value = [];
  }

  /** End a drag: the next edit is a step of its own. */
  settle() {
    const last = this._past.value.at(-1);
    if (last) this._past.value = [...this._past.value.slice(0, -1), { ...last, merge: "" }];
  }

  /** Return the step to undo, or null. */
  undo() {
    return UndoList._take(this._past, this._future);
  }

  /** Return the step to do again, or null. */
  redo() {
    return UndoList._take(this._future, this._past);
  }

  clear() {
    this._past.value = this._future.value = [];
  }

  /**
   * @template S
   * @param {{ value: S[] }} from
   * @param {{ value: S[] }} to
   */
  static _take(from, to) {
    const step = from.value.at(-1) ?? null;
    if (step !== null) {
      from.value = from.value.slice(0, -1);
      to.value = [...to.value, step];
    }
    return step;
  }
}
