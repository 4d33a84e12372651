// The choice of the language, and plurals, numbers and dates as each language has them.

import assert from "node:assert/strict";
import { test } from "node:test";

import { document, localStorage } from "./page.mjs";

const { LANGUAGES, dateAndTime, inLanguage, languageOf, list, load, number, seconds, t } =
  await import("../../../servolink/studio/web/texts/text.js");
const { said } = await import("../../../servolink/studio/web/texts/said.js");
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
    for (const [key, text] of Object.entries((await load(tag)).texts))
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
  assert.equal(list(["hip", "knee", "foot"]), "hip, knee, foot");
  const time = "2026-11-26T18:05:00";
  assert.equal(dateAndTime(time), "26 Nov 2026, 18:05");
  await chooseLanguage("zh-Hant");
  assert.equal(t("project.buttons_in", { count: 1 }), "1 個按鈕");
  assert.equal(list(["右手", "左手"]), "右手、左手");
  assert.equal(dateAndTime(time), "2026年11月26日 下午6:05");
  const names = { en: "Arm", zh: "手臂" };
  assert.deepEqual(
    [inLanguage({ ...names, "zh-Hant": "手" }), inLanguage(names), inLanguage({ en: "Arm" })],
    ["手", "手臂", "Arm"],
  );
  assert.equal(inLanguage({}), undefined);
});

test("each message has a translation of its own, whatever its values are", async () => {
  for (const tag of ["zh-Hans", "zh-Hant"]) {
    await chooseLanguage(tag);
    const messages = Object.values((await load(tag)).messages).flatMap((each) => Object.entries(each));
    assert.ok(messages.length > 50);
    for (const [english, translation] of messages) {
      if (!/\w/.test(english.replace(/\{\w+\}/g, ""))) continue; // translates its values only
      const filled = (text) => text.replace(/\{(\w+)\}/g, "<$1>");
      assert.equal(said(filled(english)), filled(translation));
    }
  }
});

test("a message within a message is translated too, line by line, and others stay as they are", async () => {
  await chooseLanguage("zh-Hant");
  const absent =
    "serial:///dev/ttyS9: cannot open it: there is no /dev/ttyS9; plug the board in and switch it on; no serial port is here";
  assert.equal(said(absent), "serial:///dev/ttyS9：無法開啟：沒有 /dev/ttyS9，請接上控制板並打開電源；這裡沒有序列埠");
  assert.equal(said("studio: a page"), "studio：某個頁面");
  assert.equal(said("log out and in again\nls"), "登出再登入\nls");
  for (const text of ["", "servo 1: nobody knows", "nothing was moved"]) assert.equal(said(text), text);
  await chooseLanguage("en");
  assert.equal(said(absent), absent);
});
