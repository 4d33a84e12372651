// Runs functions of the page for the tests: takes [module, function, arguments][] as JSON, and prints their results.

import { readFileSync } from "node:fs";

const web = new URL("../../servolink/studio/web/", import.meta.url);
const results = [];
for (const [module, name, args] of JSON.parse(readFileSync(0, "utf8"))) {
  results.push((await import(new URL(module, web)))[name](...args) ?? null);
}
const plain = (_key, value) => (value instanceof Map ? Object.fromEntries(value) : value);
process.stdout.write(JSON.stringify(results, plain));
