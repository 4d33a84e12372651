// Motions as text for another robot: clipboard.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import { projectForm } from "./page.mjs";

const { copiedText } = await import("../../../servolink/studio/web/state/clipboard.js");

const named = (id, caption = "", part = "") => ({ id, caption, part });

test("a macro is copied with all that it runs, once, and with the names of the servos", () => {
  const form = projectForm();
  const odd = { type: "other", type_number: 9, command_id: 1, ratio_percent: 100, loop: 1, total_interval_ms: 0 };
  form.macros = form.macros.map((one) => ({ ...one, commands: [...one.commands, odd] }));
  const copied = JSON.parse(copiedText(form, "macro", 2, [named(1, "servo 1")]));
  assert.deepEqual([copied.kind, copied.version], ["servolink motions", 1]);
  const ids = copied.macros.map((one) => one.macro_id);
  assert.deepEqual(ids, [2, 1]);
  assert.ok(copied.macros.every((one) => one.commands.every((command) => command.type !== "other")));
  const run = copied.macros.flatMap((one) => one.commands.flatMap((command) => command.action_id ?? []));
  assert.deepEqual([...new Set(run)].sort(), copied.actions.map((one) => one.action_id).sort());
  assert.deepEqual(copied.servos, [named(1, "servo 1"), named(2)]);
});
