// The choice of the language, and plurals, numbers and dates as each language has them.

import assert from "node:assert/strict";
import { test } from "node:test";

import { document, localStorage } from "./page.mjs";

const { LANGUAGES, dateAndTime, inLanguage, languageOf, load, number, seconds, t } =
  await import("../../../servolink/studio/web/texts/text.js");
globalThis.matchMedia = () => ({ matches: false });
document.documentElement = { dataset: {} };
const { chooseLanguage, showLanguage } = await import("../../../servolink/studio/web/state/settings.js");

const asks = (...languages) =>
  Object.defineProperty(globalThis, "navigator", { value: { languages }, configurable: true });

test("a tag leads to the writing of its region", () => {
  const found = Object.fromEntries(
    ["zh", "zh-CN", "zh-SG", "zh-Hans-HK", "zh-TW", "zh-HK", "zh-MO", "zh-Hant", "en-GB", "de", "_", ""].map((tag) => [
      tag,
      languageOf(tag),
    ]),
  );
  const [hans, hant] = ["zh-Hans", "zh-Hant"];
  assert.deepEqual(found, {
    ...{ zh: hans, "zh-CN": hans, "zh-SG": hans, "zh-Hans-HK": hans },
    ...{ "zh-TW": hant, "zh-HK": hant, "zh-MO": hant, "zh-Hant": hant },
    ...{ "en-GB": "en", de: undefined, _: undefined, "": undefined },
  });
});

test("the page takes the first language of the browser that it has, and a choice goes before", async () => {
  for (const [languages, expected] of [
    [["de", "zh-TW", "en"], "zh-Hant"],
    [["ja"], "en"],
    [["zh-CN", "zh-TW"], "zh-Hans"],
  ]) {
    asks(...languages);
    await showLanguage();
    assert.equal(document.documentElement.lang, expected);
  }
  await chooseLanguage("zh-Hant");
  await showLanguage();
  assert.equal(document.documentElement.lang, "zh-Hant");
  assert.equal(JSON.parse(localStorage.getItem("servolink.settings")).language, "zh-Hant");
});

test("each text has one form, or those that Intl.PluralRules has for its language", async () => {
  for (const tag of Object.keys(LANGUAGES)) {
    const { pluralCategories } = new Intl.PluralRules(tag).resolvedOptions();
    for (const [key, text] of Object.entries(await load(tag)))
      assert.ok([1, pluralCategories.length].includes(text.split("|").length), `${tag} ${key}`);
  }
});

test("counts, numbers, dates and names are those of the language", async () => {
  asks("en-GB", "zh-TW");
  await chooseLanguage("en");
  assert.deepEqual(
    [0, 1, 2].map((count) => t("project.buttons_in", { count })),
    ["0 buttons", "1 button", "2 buttons"],
  );
  assert.equal(number(12345.6, 2), "12,345.60");
  assert.equal(seconds(0.3), "0.30 s");
  const time = "2026-11-26T18:05:00";
  assert.equal(dateAndTime(time), "26 Nov 2026, 18:05");
  await chooseLanguage("zh-Hant");
  assert.equal(t("project.buttons_in", { count: 1 }), "1 個按鈕");
  assert.equal(dateAndTime(time), "2026年11月26日 下午6:05");
  const names = { en: "Arm", zh: "手臂" };
  assert.deepEqual(
    [inLanguage({ ...names, "zh-Hant": "手" }), inLanguage(names), inLanguage({ en: "Arm" })],
    ["手", "手臂", "Arm"],
  );
  assert.equal(inLanguage({}), undefined);
});
