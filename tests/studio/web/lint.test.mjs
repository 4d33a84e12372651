import assert from "node:assert/strict";
import { createRequire } from "node:module";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

const studio = new URL("../../../servolink/studio/", import.meta.url);
const { ESLint } = createRequire(new URL("package.json", studio))("eslint");
const eslint = new ESLint({ cwd: fileURLToPath(studio) });

/** Return the rules that a module of the page breaks. */
async function broken(filePath, text) {
  const [{ messages }] = await eslint.lintText(text, { filePath: fileURLToPath(new URL(filePath, studio)) });
  return messages.map(({ ruleId }) => ruleId);
}

const IMPORT = 'import { chosen } from "../state/view.js";\n';

for (const write of [
  "chosen.value = 1;",
  'chosen["value"] = 1;',
  "chosen.value += 1;",
  "chosen.value++;",
  "[chosen.value] = [1];",
  "[chosen.value = 1] = [];",
  "({ id: chosen.value } = { id: 1 });",
  "for (chosen.value of [1]);",
  "export const choose = () => (chosen.value = 1);",
]) {
  test(`outside state/ a signal must not be written: ${write}`, async () => {
    assert.deepEqual(await broken("web/parts/part.js", IMPORT + write), ["no-restricted-syntax"]);
    assert.deepEqual(await broken("web/texts/text.js", IMPORT + write), ["no-restricted-syntax"]);
    assert.deepEqual(await broken("web/state/part.js", IMPORT + write), []);
  });
}

test("inputs are written everywhere, and signals read", async () => {
  const code = "export function show(field) {\n  field.value = field.current.value = String(chosen.value);\n}\n";
  assert.deepEqual(await broken("web/parts/part.js", IMPORT + code), []);
});

test("outside state/ no signal is made", async () => {
  const code = 'import { signal } from "../html.js";\nexport const mine = signal(0);\n';
  assert.deepEqual(await broken("web/parts/part.js", code), ["no-restricted-syntax"]);
  assert.deepEqual(await broken("web/state/part.js", code), []);
});
