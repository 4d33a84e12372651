// Editor of the text of a program: CodeMirror, loaded when the screen is first opened.

import { t } from "../../texts/text.js";

/** Editor in an element of the page. @typedef {{ show: (text: string) => void, mark: (line: number) => void, close: () => void }} Editor */

/**
 * Make an editor. Rejects if the page cannot be reached.
 * @param {HTMLElement} parent
 * @param {string} text
 * @param {(text: string) => void} onChange called with each change by a person
 * @returns {Promise<Editor>}
 */
export async function makeEditor(parent, text, onChange) {
  const cm = await import("../../vendor/codemirror/codemirror.js");
  const marked = cm.StateEffect.define();
  const marks = cm.StateField.define({
    create: () => cm.Decoration.none,
    update: (/** @type {any} */ found, /** @type {any} */ change) => {
      const line = change.effects.find((/** @type {any} */ effect) => effect.is(marked))?.value;
      if (line === undefined) return change.docChanged ? cm.Decoration.none : found;
      if (line < 1 || line > change.state.doc.lines) return cm.Decoration.none;
      const at = cm.Decoration.line({ class: "mistake" }).range(change.state.doc.line(line).from);
      return cm.Decoration.set([at]);
    },
    provide: (/** @type {any} */ field) => cm.EditorView.decorations.from(field),
  });
  const view = new cm.EditorView({
    parent,
    doc: text,
    extensions: [
      cm.lineNumbers(),
      cm.history(),
      cm.indentOnInput(),
      cm.indentUnit.of("    "),
      cm.bracketMatching(),
      cm.closeBrackets(),
      cm.syntaxHighlighting(cm.classHighlighter),
      cm.python(),
      cm.keymap.of([...cm.closeBracketsKeymap, ...cm.defaultKeymap, ...cm.historyKeymap, cm.indentWithTab]),
      cm.EditorView.contentAttributes.of({ "aria-label": t("code.editor") }),
      cm.EditorView.updateListener.of((/** @type {any} */ { docChanged, state }) => {
        if (docChanged) onChange(state.doc.toString());
      }),
      marks,
    ],
  });
  return {
    show: (next) => {
      if (next !== view.state.doc.toString())
        view.dispatch({ changes: { from: 0, to: view.state.doc.length, insert: next } });
    },
    mark: (line) => view.dispatch({ effects: marked.of(line) }),
    close: () => view.destroy(),
  };
}
