// Code: a program in Python, and beside it what the program prints, and its errors in plain words.

import { html, useEffect, useRef, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { saveBytes } from "../../parts/save-bytes.js";
import * as code from "../../state/code.js";
import { beginLasting } from "../../state/lasting.js";
import { hold, isLive, isOthers } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { said } from "../../texts/said.js";
import { t, texts } from "../../texts/text.js";
import { makeEditor } from "./editor.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../texts/text.js").Key} Key */
/** @typedef {{ name: string, text: string }[]} Examples programs of the documentation; the build writes them */

const MOST = 1_000_000; // bytes of a file

/** @param {Tools} tools */
export function CodeScreen({ motion }) {
  const [examples, setExamples] = useState(/** @type {Examples} */ ([]));
  useEffect(() => {
    code.prepareProgram();
    fetch("examples.json")
      .then((response) => response.json())
      .then((/** @type {Examples} */ found) => {
        setExamples(found);
        if (code.program.value === null) code.changeProgram(found[0].text);
      })
      .catch(() => code.changeProgram(code.program.value ?? ""));
  }, []);
  const isRunning = code.course.value === "running",
    mayRun = code.isReady.value && isLive.value && !isOthers.value && hold.value === null;
  const begin = () => code.runProgram(motion).catch((error) => toast({ kind: "bad", title: error.message }));
  const run = () => beginLasting(begin);
  return html`<h1 class="sr">${t("screen.code")}</h1><div class="code">
    <section class="card" aria-labelledby="code-title">
      <header class="row wrap">
        <h2 id="code-title" class="grow">${t("code.title")}</h2>
        <select class="inp" aria-label=${t("code.examples")} onChange=${(/** @type {Event} */ event) => choose(event, examples)}>
          <option value="">${t("code.examples")}</option>
          ${examples.map(({ name }) => html`<option key=${name} value=${name}>${t(/** @type {Key} */ (`code.example.${name}`))}</option>`)}
        </select>
        <label class="btn">${t("code.open")}<input type="file" class="sr" accept=".py,text/x-python,text/plain" onChange=${open} /></label>
        <button class="btn" onClick=${save}>${t("code.save")}</button>
        ${
          isRunning
            ? html`<button class="btn pri" onClick=${code.stopProgram}>${t("code.stop")}</button>`
            : html`<button class="btn pri" disabled=${!mayRun} onClick=${run}><${Icon} name="play" />${t(code.isReady.value ? "code.run" : "code.loading")}</button>`
        }
      </header>
      ${code.program.value !== null && html`<${Text} />`}
    </section>
    <section class="card side" aria-labelledby="code-output">
      <header><h2 id="code-output">${t("code.output")}</h2></header>
      <div class="pad col">
        <${Course} />
        <pre class="printed" tabindex="0" aria-labelledby="code-output">${code.output.value}</pre>
      </div>
    </section>
  </div>`;
}

/** The editor. */
function Text() {
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  const [editor, setEditor] = useState(/** @type {import("./editor.js").Editor | null} */ (null));
  useEffect(() => {
    const made = makeEditor(/** @type {HTMLElement} */ (place.current), code.program.value ?? "", code.changeProgram);
    made.then(setEditor, (error) => toast({ kind: "bad", title: String(error) }));
    return () => void made.then((one) => one.close());
  }, []);
  useEffect(() => editor?.show(code.program.value ?? ""), [editor, code.program.value]);
  useEffect(() => editor?.mark(code.mistake.value?.line ?? 0), [editor, code.mistake.value]);
  return html`<div class="codespace" ref=${place}></div>`;
}

/** How the program goes or has ended; an error with its line, what it means, and the words of Python. */
function Course() {
  const course = code.course.value,
    mistake = code.mistake.value;
  if (course === "") return html`<p class="mut">${t("code.hint")}</p>`;
  if (mistake === null)
    return html`<p role="status" class="mut">${t(/** @type {Key} */ (`code.course.${course}`))}</p>`;
  const { kind, line, message, trace } = mistake,
    key = /** @type {Key} */ (`code.mistake.${kind}`);
  const meaning = key in texts.value.texts ? t(key) : said(safeText(message)) || kind;
  const title = line > 0 ? t("code.line", { line, meaning }) : meaning;
  return html`<${Note} kind="bad" urgent title=${title} detail=${key in texts.value.texts ? `${kind}: ${safeText(message)}` : ""} />
    <details><summary>${t("code.details")}</summary><pre tabindex="0">${trace.split("\n").map(safeText).join("\n")}</pre></details>`;
}

/** @param {Event} event @param {Examples} examples */
function choose({ currentTarget }, examples) {
  const field = /** @type {HTMLSelectElement} */ (currentTarget);
  const chosen = examples.find(({ name }) => name === field.value);
  field.value = "";
  if (chosen) replace(chosen.text);
}

/** @param {Event} event */
async function open({ currentTarget }) {
  const field = /** @type {HTMLInputElement} */ (currentTarget),
    file = field.files?.[0];
  if (file && file.size <= MOST) replace(await file.text());
  field.value = "";
}

/** Show another text in place of the program, with a way back; it runs only after Run. @param {string} text */
function replace(text) {
  const before = code.program.value ?? "";
  code.changeProgram(text);
  toast({
    name: "code",
    title: t("code.replaced"),
    action: { label: t("edit.undo"), run: () => code.changeProgram(before) },
  });
}

const save = () => saveBytes("program.py", "text/x-python", [code.program.value ?? ""]);
