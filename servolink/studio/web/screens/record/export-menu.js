// What to make of a recording.

import { html } from "../../html.js";
import { Menu } from "../../parts/menu.js";
import { t } from "../../texts/text.js";
import { makeActions, saveRecording, saveTable } from "./export.js";

/** @param {{ link: import("../../link/link.js").Link }} props */
export const Export = ({ link }) =>
  html`<${Menu} label=${t("record.export")} items=${[
    { label: t("record.export_recording"), run: () => saveRecording(link) },
    { label: t("record.export_table"), run: saveTable },
    { label: t("record.export_actions"), run: makeActions },
  ]} />`;
