// Blockly, loaded when the screen is first opened. The page's content policy forbids style sheets that a script puts in,
// so Blockly gets a file instead, and a renderer that puts in none.

import { language } from "../../texts/text.js";

const SHEET = "/vendor/blockly/blockly.css";

/** Messages of Blockly by language of the page. @type {Record<import("../../texts/text.js").Language, () => Promise<{ default: Record<string, string> }>>} */
const MESSAGES = {
  en: () => import("../../vendor/blockly/en.js"),
  "zh-Hans": () => import("../../vendor/blockly/zh-hans.js"),
  "zh-Hant": () => import("../../vendor/blockly/zh-hant.js"),
};
/** Colours dark enough for white letters, by kind of block. */
const COLOURS = {
  start: "#9a3d12",
  pose: "#06625b",
  servo: "#33546f",
  command: "#4343bd",
  control: "#775300",
  refused: "#5f6762",
};

/** Return Blockly in the language of the page. Rejects if the studio does not answer. */
export async function loadBlockly() {
  const [{ default: Blockly }, messages] = await Promise.all([
    import("../../vendor/blockly/blockly.js"),
    MESSAGES[language.value](),
    loadSheet(),
  ]);
  Blockly.setLocale(messages.default);
  if (!Blockly.registry.hasItem(Blockly.registry.Type.RENDERER, "studio")) register(Blockly);
  return Blockly;
}

/**
 * Load the style sheet of Blockly, unless the page has the sheet already.
 * @returns {Promise<void>}
 */
function loadSheet() {
  if (document.querySelector(`link[href="${SHEET}"]`)) return Promise.resolve();
  const link = Object.assign(document.createElement("link"), { rel: "stylesheet", href: SHEET });
  return new Promise((resolve, reject) => {
    link.addEventListener("load", () => resolve());
    link.addEventListener("error", () => {
      link.remove();
      reject(new Error(SHEET));
    });
    document.head.prepend(link); // before our own sheets, which change parts of it
  });
}

/**
 * Register the renderer without a style sheet, and the theme with the colours of the blocks.
 * @param {any} Blockly
 */
function register(Blockly) {
  class Constants extends Blockly.zelos.ConstantProvider {
    injectCSS_() {}
  }
  class Renderer extends Blockly.zelos.Renderer {
    makeConstants_() {
      return new Constants();
    }
  }
  Blockly.blockRendering.register("studio", Renderer);
  Blockly.Theme.defineTheme("studio", {
    name: "studio",
    base: "zelos",
    blockStyles: Object.fromEntries(
      Object.entries(COLOURS).map(([name, colour]) => [
        `${name}_blocks`,
        { colourPrimary: colour, hat: name === "start" ? "cap" : "" },
      ]),
    ),
    categoryStyles: Object.fromEntries(
      Object.entries(COLOURS).map(([name, colour]) => [`${name}_category`, { colour }]),
    ),
    fontStyle: { family: "Inter, sans-serif", weight: "540", size: 11 },
  });
}
