// CodeMirror, of which the page uses too many parts to describe each.
declare const part: any;
export {
  part as bracketMatching,
  part as classHighlighter,
  part as closeBrackets,
  part as closeBracketsKeymap,
  part as Decoration,
  part as defaultKeymap,
  part as EditorView,
  part as history,
  part as historyKeymap,
  part as indentOnInput,
  part as indentUnit,
  part as indentWithTab,
  part as keymap,
  part as lineNumbers,
  part as python,
  part as StateEffect,
  part as StateField,
  part as syntaxHighlighting,
};
