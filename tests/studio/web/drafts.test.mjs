// Edits that are kept in the studio, and in the browser until then: drafts.js.

import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";
import { FakeLink, localStorage, turns, window } from "./page.mjs";

const web = "../../../servolink/studio/web/";
const { Drafts } = await import(`${web}state/drafts.js`);
const { LinkLost } = await import(`${web}link/link.js`);

const KEY = "servolink.unsaved.rex";
let link, differences, heard, states, drafts;

/** Return an action in which the draft differs from the board. */
const difference = (id, caption) => ({
  kind: "actions",
  id,
  change: "changed",
  before: { action_id: id, action_caption: "old" },
  after: caption === null ? undefined : { action_id: id, action_caption: caption },
});

/** Return an action as the studio keeps it. */
const kept = (id, revision, caption) => ({
  kind: "actions",
  id,
  revision,
  who: "another page",
  base: null,
  record: caption === null ? null : { action_id: id, action_caption: caption },
  is_discarded: caption === null,
});

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout"] });
  localStorage.clear();
  link = new FakeLink();
  [differences, heard, states] = [[], [], []];
  drafts = new Drafts(link, "rex", {
    differences: () => differences,
    onTheirs: (one, isConflict) => heard.push([one.id, isConflict]),
    onKept: (state) => states.push(state),
  });
});

afterEach(() => {
  mock.timers.reset();
});

/** Load the edits that the studio keeps. */
async function load(...records) {
  const loaded = drafts.load();
  link.taken("studio.draft.get").resolve({ records });
  return await loaded;
}

/** Let the time pass after which edits are saved, and return the request. */
async function saving(milliseconds = 400) {
  mock.timers.tick(milliseconds);
  await turns();
  return link.taken("studio.draft.save");
}

test("edits of the studio come first, then those that only this browser has", async () => {
  const mine = { kind: "actions", id: 2, known: 1, base: null, record: { action_id: 2 }, is_discarded: false };
  localStorage.setItem(KEY, JSON.stringify([mine]));
  assert.deepEqual(await load(kept(1, 3, "theirs"), kept(5, 4, null)), [kept(1, 3, "theirs"), mine]);
});

test("damaged edits of this browser are left out", async () => {
  localStorage.setItem(KEY, "{");
  assert.deepEqual(await load(), []);
});

test("an edit is in the browser until the studio has it", async () => {
  await load();
  differences = [difference(1, "new")];
  drafts.saveSoon();
  const request = await saving();
  assert.deepEqual(request.params.edits, [
    {
      kind: "actions",
      id: 1,
      known: 0,
      base: differences[0].before,
      record: differences[0].after,
      is_discarded: false,
    },
  ]);
  assert.deepEqual(JSON.parse(localStorage.getItem(KEY)), request.params.edits);
  request.resolve({ saved: [kept(1, 1, "new")], conflicts: [] });
  await turns();
  assert.equal(await saving(), null);
  assert.equal(localStorage.getItem(KEY), null);
  assert.deepEqual(states, ["saved"]);
});

test("many edits in a moment are saved together", async () => {
  await load();
  for (const id of [1, 2, 3]) {
    differences = [...differences, difference(id, "new")];
    drafts.saveSoon();
    mock.timers.tick(300);
  }
  const request = await saving(100);
  assert.equal(request.params.edits.length, 3);
});

test("an edit that is taken back is given up in the studio", async () => {
  await load(kept(1, 3, "new"));
  drafts.saveSoon();
  const [edit] = (await saving()).params.edits;
  assert.deepEqual([edit.id, edit.known, edit.record, edit.is_discarded], [1, 3, null, true]);
});

test("without a connection edits stay here and are saved again", async () => {
  await load();
  differences = [difference(1, "new")];
  drafts.saveSoon();
  (await saving()).reject(new LinkLost());
  await turns();
  assert.deepEqual(states, ["here"]);
  assert.equal(await saving(400), null);
  assert.ok(await saving(2600));
});

test("an edit that the studio refuses waits for the next edit", async () => {
  await load();
  differences = [difference(1, "new")];
  drafts.saveSoon();
  (await saving()).reject(new Error("the disk is full"));
  await turns();
  assert.deepEqual(states, ["here"]);
  assert.equal(await saving(60_000), null);
});

test("a newer edit of another page is a conflict when this one is saved", async () => {
  await load(kept(1, 3, "old"));
  differences = [difference(1, "mine")];
  drafts.saveSoon();
  (await saving()).resolve({ saved: [], conflicts: [kept(1, 4, "theirs")] });
  await turns();
  assert.deepEqual(heard, [[1, true]]);
});

test("edits of other pages are taken once, and those of records edited here meet them when saved", async () => {
  await load(kept(1, 3, "new"));
  differences = [difference(1, "new"), difference(2, "mine")];
  link.hear("studio.draft", { records: [kept(1, 3, "new"), kept(2, 9, "theirs"), kept(4, 1, "theirs")] });
  assert.deepEqual(heard, [[4, false]]);
  link.hear("studio.draft", { records: [kept(4, 1, "theirs")] });
  assert.equal(heard.length, 1);
});

test("a record that this page has saved and another page changes later is a conflict", async () => {
  await load();
  differences = [difference(1, "mine")];
  drafts.saveSoon();
  (await saving()).resolve({ saved: [kept(1, 1, "mine")], conflicts: [] });
  await turns();
  link.hear("studio.draft", { records: [kept(1, 2, "theirs")] });
  assert.deepEqual(heard, [[1, true]]);
  differences = [difference(1, "theirs")]; // taken over
  link.hear("studio.draft", { records: [kept(1, 3, "theirs again")] });
  assert.deepEqual(heard.at(-1), [1, false]);
});

test("a new connection asks what other pages have edited meanwhile", async () => {
  await load();
  const resumed = drafts.resume();
  link.taken("studio.draft.get").resolve({ records: [kept(3, 1, "theirs")] });
  await resumed;
  assert.deepEqual(heard, [[3, false]]);
});

test("leaving the page keeps in the browser what was not saved", async () => {
  await load();
  differences = [difference(1, "new")];
  window.dispatchEvent(new Event("pagehide"));
  assert.equal(JSON.parse(localStorage.getItem(KEY))[0].id, 1);
});
