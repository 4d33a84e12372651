// What the compiler does not see in the page's own modules: names that are not used, and code that nobody reaches.

const BROWSER = [
  "AbortController", "addEventListener", "atob", "Blob", "BroadcastChannel", "caches", "cancelAnimationFrame", "clearInterval", "clearTimeout", "confirm", "console",
  "CustomEvent", "devicePixelRatio", "document", "Element", "Event", "EventSource", "EventTarget", "fetch", "File", "getComputedStyle", "history",
  "HTMLElement", "HTMLInputElement", "innerHeight", "innerWidth", "IntersectionObserver", "isSecureContext", "KeyboardEvent", "localStorage", "location", "matchMedia",
  "MessageChannel", "MouseEvent", "navigator", "performance", "PointerEvent", "postMessage", "queueMicrotask", "removeEventListener",
  "requestAnimationFrame", "ResizeObserver", "Response", "self", "sessionStorage", "setInterval", "setTimeout", "structuredClone", "TextDecoder",
  "TextEncoder", "URL", "URLSearchParams", "WebSocket", "window", "Worker",
];

// The compiler cannot tell a signal from an input by the name `value`, and neither can a selector. So variables that hold an
// input, or refer to one, have one of these names, and any other `value` counts as that of a signal.
const FIELD = "/^(field|slider)$/";
const VALUE = ":matches(MemberExpression[property.name='value'], MemberExpression[property.value='value'])";
const SIGNAL = `${VALUE}:not([object.name=${FIELD}], [object.object.name=${FIELD}][object.property.name='current'])`;
const WRITES = "signals are written in state/ only: call a function there that names what happens";
// Each place of the syntax in which a member is given a value: assignment, step, loop and destructuring.
const ONLY_STATE_WRITES_SIGNALS = [
  { selector: `:matches(AssignmentExpression, AssignmentPattern) > ${SIGNAL}.left`, message: WRITES },
  { selector: `:matches(ForOfStatement, ForInStatement) > ${SIGNAL}.left`, message: WRITES },
  { selector: `UpdateExpression > ${SIGNAL}`, message: WRITES },
  { selector: `ArrayPattern > ${SIGNAL}, ObjectPattern > Property > ${SIGNAL}.value`, message: WRITES },
];
// Screens that make signals would soon share them with each other, past the functions of `state/`.
const ONLY_STATE_MAKES_SIGNALS = {
  selector: "ImportSpecifier[imported.name=/^(signal|useSignal)$/]",
  message: "signals live in state/, or useState holds what only one component knows",
};

export default [
  { ignores: ["**/vendor/**"] },
  {
    files: ["**/*.js"],
    languageOptions: { globals: Object.fromEntries(BROWSER.map((name) => [name, "readonly"])) },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      "array-callback-return": "error",
      "default-case-last": "error",
      eqeqeq: "error",
      "no-constant-condition": "error",
      "no-console": "error",
      "no-debugger": "error",
      "no-dupe-keys": "error",
      "no-duplicate-imports": "error",
      "no-else-return": "error",
      "no-empty": ["error", { allowEmptyCatch: true }],
      "no-eval": "error",
      "no-fallthrough": "error",
      "no-implied-eval": "error",
      "no-new-func": "error",
      "no-self-compare": "error",
      "no-unmodified-loop-condition": "error",
      "no-unreachable": "error",
      "no-undef": "error",
      "no-unused-expressions": ["error", { allowTernary: true, allowShortCircuit: true, allowTaggedTemplates: true }],
      "no-unused-vars": ["error", { varsIgnorePattern: "^_" }],
      "no-useless-return": "error",
      "no-useless-concat": "error",
      "no-var": "error",
      "object-shorthand": "error",
      "prefer-const": "error",
      "prefer-template": "error",
      "no-restricted-properties": ["error",
        { property: "innerHTML", message: "texts of others become text nodes only" },
        { property: "outerHTML", message: "texts of others become text nodes only" },
        { property: "insertAdjacentHTML", message: "texts of others become text nodes only" },
        { object: "document", property: "write", message: "texts of others become text nodes only" },
        { property: "dangerouslySetInnerHTML", message: "texts of others become text nodes only" },
      ],
    },
  },
  {
    files: ["web/**/*.js"],
    ignores: ["web/state/**"],
    rules: { "no-restricted-syntax": ["error", ...ONLY_STATE_WRITES_SIGNALS, ONLY_STATE_MAKES_SIGNALS] },
  },
  {
    // This module makes the signal of the language: modules of `state/` need texts, so it cannot import from them.
    files: ["web/texts/text.js"],
    rules: { "no-restricted-syntax": ["error", ...ONLY_STATE_WRITES_SIGNALS] },
  },
];
