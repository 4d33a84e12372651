// The draft of a project from reading the board to writing it: project.js and plan.js.

import assert from "node:assert/strict";
import { after, before, beforeEach, mock, test } from "node:test";
import { FakeLink, projectForm, turns } from "./page.mjs";

const web = "../../../servolink/studio/web/";
const project = await import(`${web}state/project.js`);
const plan = await import(`${web}state/plan.js`);
const { withRecord } = await import(`${web}state/records.js`);
const { captions, linkState, welcome } = await import(`${web}state/robot.js`);
const { draft, stored } = project;

const link = new FakeLink();

before(async () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  welcome.value = { session: "mine", role: "edit", name: "rex" };
  linkState.value = "open";
});

after(() => mock.timers.reset());

/** Answer the requests of reading the board. */
async function read(form) {
  link.taken("project.export").resolve({ project: form });
  await turns();
  link.taken("studio.draft.get")?.resolve({ records: [] });
  await turns();
}

beforeEach(async () => {
  link.asked.length = 0;
  const reading = project.reread(link);
  const form = projectForm();
  await read(form);
  await reading;
  draft.value = stored.value = form; // as if nothing had been edited
  project.conflict.value = null;
});

/** Rename an action of the draft. */
const rename = (action_caption, merge) =>
  project.edit(
    ["actions.did_rename", { to: action_caption }],
    (before) => withRecord(before, "actions", { ...before.actions[0], action_caption }),
    merge,
  );

const caption = () => draft.value.actions[0].action_caption;

test("what was read is stored and drafted, and names the servos", () => {
  assert.equal(project.reading.value.state, "ready");
  assert.equal(stored.value, draft.value);
  assert.deepEqual(captions.value, { 1: "servo 1", 2: "servo 2" });
  assert.equal(project.isCurrent.value, true);
});

test("reading shows its progress, and why it failed", async () => {
  const reading = project.reread(link);
  const request = link.taken("project.export");
  request.onProgress({ done: 3, total: 9, item: "action 3" });
  assert.deepEqual(project.reading.value, { state: "reading", done: 3, total: 9, item: "action 3", error: "" });
  request.reject(new Error("no answer"));
  await reading;
  assert.equal(project.reading.value.state, "failed");
  assert.equal(project.reading.value.error, "no answer");
  assert.equal(caption(), "up");
});

test("an edit changes the draft alone, and can be undone and done again", () => {
  assert.equal(rename("high"), true);
  assert.deepEqual([caption(), stored.value.actions[0].action_caption], ["high", "up"]);
  assert.deepEqual(
    project.differences.value.map((one) => [one.kind, one.id, one.change]),
    [["actions", 1, "changed"]],
  );
  assert.equal(project.keeping.value, "saving");
  assert.deepEqual(project.undo(), ["actions.did_rename", { to: "high" }]);
  assert.equal(caption(), "up");
  assert.deepEqual(project.redo(), ["actions.did_rename", { to: "high" }]);
  assert.equal(caption(), "high");
});

test("a change that changes nothing is no step", () => {
  const label = project.undoLabel.value;
  assert.equal(
    project.edit(["actions.did_rename"], (same) => same),
    false,
  );
  assert.equal(project.undoLabel.value, label);
});

test("the parts of a drag are one step until it ends", () => {
  for (const text of ["a", "ab", "abc"]) rename(text, "typing");
  project.settle();
  rename("abcd", "typing");
  project.undo();
  assert.equal(caption(), "abc");
  project.undo();
  assert.equal(caption(), "up");
});

test("an edit of an action brings the durations of macros up to date", () => {
  project.edit(["actions.did_time"], (before) =>
    withRecord(before, "actions", {
      ...before.actions[1],
      steps: [{ servo_id: 1, degree: 0, interval_ms: 800 }],
    }),
  );
  assert.deepEqual(
    draft.value.macros.map((one) => one.commands.map((command) => command.total_interval_ms)),
    [
      [1000, 800],
      [1800, 200],
    ],
  );
});

test("reading again keeps edits, and takes the rest from the board", async () => {
  rename("high");
  const reading = project.reread(link);
  const form = projectForm();
  form.actions[0].action_caption = "written by another program";
  form.actions[1].action_caption = "low";
  await read(form);
  await reading;
  assert.deepEqual(
    draft.value.actions.map((one) => one.action_caption),
    ["high", "low"],
  );
  assert.equal(stored.value, form);
});

test("undo leaves what another page has edited since", () => {
  rename("high");
  const record = { ...projectForm().macros[0], macro_caption: "theirs" };
  const kept = { kind: "macros", id: 1, revision: 1, who: "Ann", base: null, record, is_discarded: false };
  link.hear("studio.draft", { records: [kept] });
  const captions = () => [caption(), draft.value.macros[0].macro_caption];
  assert.deepEqual(captions(), ["high", "theirs"]);
  assert.equal(project.conflict.value, null);
  project.undo();
  assert.deepEqual(captions(), ["up", "theirs"]);
});

test("a record that another page has deleted is told of, with what it was", () => {
  const record = { kind: "actions", id: 2, who: "Ann", base: null, record: null, is_discarded: false };
  link.hear("studio.draft", { records: [{ ...record, revision: 1 }] });
  assert.equal(draft.value.actions.length, 1);
  const { isDeleted, mine, theirs } = project.conflict.value;
  assert.deepEqual([isDeleted, mine.action_caption, theirs.who], [true, "down", "Ann"]);
});

test("edits that another page gives up are those of the board, which is read again", async () => {
  rename("high");
  const record = { kind: "actions", id: 1, who: "Ann", base: null, record: null, is_discarded: true };
  mock.timers.tick(400); // saved, so that the edit is not only of this page
  const saved = link.taken("studio.draft.save");
  saved.resolve({
    saved: [{ ...saved.params.edits[0], revision: 1 }],
    conflicts: [],
  });
  await turns();
  link.hear("studio.draft", { records: [{ ...record, revision: 2 }] });
  assert.equal(caption(), "up");
  assert.equal(link.taken("project.export"), null);
  mock.timers.tick(500);
  assert.ok(link.taken("project.export"));
});

test("a plan is for the draft of its time, and a project with errors has none", async () => {
  const planning = plan.makePlan(link);
  assert.equal(plan.isPlanning.value, true);
  link.taken("studio.check").resolve({ found: [] });
  await turns();
  link.taken("project.plan").resolve({ changes: [{ what: "action 1" }] });
  await planning;
  assert.deepEqual([plan.plan.value.of, plan.plan.value.plan.changes.length], [draft.value, 1]);
  const again = plan.makePlan(link);
  const found = [{ path: "actions", text: "too long", severity: "error" }];
  link.taken("studio.check").resolve({ found });
  await again;
  assert.equal(link.taken("project.plan"), null);
  assert.deepEqual([plan.plan.value.found, plan.plan.value.plan.changes], [found, []]);
  assert.equal(plan.isPlanning.value, false);
  plan.dropPlan();
  assert.equal(plan.plan.value, null);
});

test("a draft that changes while it is compared is compared again", async () => {
  const planning = plan.makePlan(link);
  rename("high");
  await plan.makePlan(link);
  for (let times = 0; times < 2; times += 1) {
    link.taken("studio.check").resolve({ found: [] });
    await turns();
    link.taken("project.plan").resolve({ changes: [] });
    await turns();
  }
  await planning;
  assert.equal(plan.plan.value.of, draft.value);
  assert.deepEqual([link.taken("studio.check"), plan.isPlanning.value], [null, false]);
});

test("a plan that fails says why", async () => {
  const planning = plan.makePlan(link);
  link.taken("studio.check").reject(new Error("no board"));
  await planning;
  assert.deepEqual([plan.planError.value, plan.isPlanning.value], ["no board", false]);
});

test("while the board is written nothing else is, and then it is read again", async () => {
  const writing = plan.apply(link);
  const request = link.taken("project.apply");
  assert.equal(request.params.project, draft.value);
  request.onProgress({ phase: "writing", done: 1, total: 2, item: "action 1" });
  assert.equal(plan.progress.value.phase, "writing");
  await plan.rollBack(link, null);
  await plan.makePlan(link);
  assert.equal(link.taken("project.rollback"), null);
  assert.equal(link.taken("studio.check"), null);
  request.resolve({ backup: "rex-1.json" });
  await turns();
  link.taken("project.backups").resolve({ backups: [{ number: 1 }, { number: 2 }] });
  await read(projectForm());
  await writing;
  assert.deepEqual(plan.outcome.value, { state: "written", text: "rex-1.json", of: draft.value });
  assert.equal(plan.progress.value, null);
  assert.deepEqual(
    plan.backups.value.map((one) => one.number),
    [2, 1],
  );
});

test("a write that breaks off says why, and the board is read all the same", async () => {
  const writing = plan.rollBack(link, 2);
  const request = link.taken("project.rollback");
  assert.deepEqual(request.params, { backup: 2 });
  request.reject(new Error("the line is cut"));
  await turns();
  link.taken("project.backups").reject(new Error("the line is cut"));
  await read(projectForm());
  await writing;
  assert.deepEqual([plan.outcome.value.state, plan.outcome.value.text], ["broken", "the line is cut"]);
  assert.deepEqual(plan.backups.value, []);
});
