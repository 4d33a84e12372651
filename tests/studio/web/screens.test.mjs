// State of the screens: shown-action.js, shown-macro.js, macro-preview.js, timeline.js, pad.js, recording.js, teaching.js,
// limp.js, fitting.js, button-events.js, toasts.js and view.js.

import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";
import { FakeLink, frame, projectForm, sessionStorage, turns } from "./page.mjs";

const state = "../../../servolink/studio/web/state/";
const actions = await import(`${state}shown-action.js`);
const macros = await import(`${state}shown-macro.js`);
const preview = await import(`${state}macro-preview.js`);
const timeline = await import(`${state}timeline.js`);
const pad = await import(`${state}pad.js`);
const recording = await import(`${state}recording.js`);
const teaching = await import(`${state}teaching.js`);
const fitting = await import(`${state}fitting.js`);
const buttons = await import(`${state}button-events.js`);
const toasts = await import(`${state}toasts.js`);
const view = await import(`${state}view.js`);
const { followLibrary } = await import(`${state}library.js`);
const { released } = await import(`${state}limp.js`);
const { draft, stored, undo } = await import(`${state}project.js`);
const { boardState, history, lease, linkState, readAt, servoIds, servos, welcome } = await import(`${state}robot.js`);
const { ownFigure } = await import(`${state}figure.js`);

const mine = { session: "mine", who: "a page", since: 0, dead_man: 3 };
const link = new FakeLink(); // one for all: what is taught keeps its link
followLibrary(link);

/** Let the servos report angles. */
function report(angles, is_hold = true) {
  const frames = Object.entries(angles).map(([id, angle]) => ({
    servo_id: Number(id),
    angle,
    is_start: true,
    is_hold,
  }));
  servos.value = new Map(frames.map((servo) => [servo.servo_id, servo]));
  servoIds.value = frames.map((servo) => servo.servo_id);
  readAt.value = performance.now() + 1000;
}

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout", "setInterval"] });
  link.asked.length = 0;
  welcome.value = { session: "mine", role: "edit", name: "rex", profile: null };
  linkState.value = "open";
  boardState.value = "connected";
  lease.value = null;
  draft.value = stored.value = projectForm();
  view.chooseAction(0);
  macros.showMacro(0);
  report({ 1: 10, 2: 20 });
});

afterEach(() => {
  mock.timers.reset();
});

test("the first action is shown until another one is chosen, and when the chosen one is gone", () => {
  assert.equal(actions.action.value.action_id, 1);
  view.chooseAction(2);
  assert.equal(actions.action.value.action_id, 2);
  draft.value = { ...draft.value, actions: draft.value.actions.slice(0, 1) };
  assert.equal(actions.action.value.action_id, 1);
});

test("the ghost is the action before in a macro, another action, or the robot", () => {
  view.chooseAction(2);
  actions.chooseGhost("before");
  assert.equal(actions.ghostAction.value.action_id, 1);
  actions.chooseGhost(2);
  assert.equal(actions.ghostAction.value.action_id, 2);
  actions.chooseGhost("robot");
  assert.equal(actions.ghostAction.value, null);
  assert.deepEqual(actions.startPose(null), { 1: 10, 2: 20 });
  actions.toggleGhost();
  assert.equal(actions.showsGhost.value, false);
});

test("an action that is added is shown, and an edit of it can be undone", () => {
  actions.addAction("actions.did_add", "new", []);
  assert.deepEqual([actions.action.value.action_id, actions.nameOfAction(actions.action.value)], [3, "new"]);
  actions.changeAction("actions.did_rename", (one) => ({ ...one, action_caption: "newer" }));
  assert.equal(actions.action.value.action_caption, "newer");
  undo();
  assert.equal(actions.action.value.action_caption, "new");
});

test("a command is put in after the chosen one, which it becomes", () => {
  macros.chooseClip(0);
  macros.insertCommand("delay", 300);
  assert.equal(macros.chosenClip.value, 1);
  assert.deepEqual(
    macros.macro.value.commands.map((command) => command.type),
    ["action", "delay", "action"],
  );
  macros.chooseClip(null);
  macros.insertCommand("action", 1);
  assert.equal(macros.chosenClip.value, 3);
});

test("another macro is shown as a whole", () => {
  macros.chooseClip(1);
  macros.showMacro(2);
  assert.deepEqual([macros.macro.value.macro_id, macros.chosenClip.value], [2, null]);
  macros.chooseClip(1);
  draft.value = { ...draft.value, macros: draft.value.macros.slice(0, 1) }; // deleted by another page
  assert.deepEqual([macros.macro.value.macro_id, macros.chosenClip.value], [1, null]);
  macros.addEmptyMacro();
  assert.equal(macros.macro.value.macro_id, 2);
});

test("turns above the cap are found, from where the robot was when the screen was opened", () => {
  macros.startFromRobot();
  assert.deepEqual(macros.start.value, { 1: 10, 2: 20 });
  assert.equal(macros.fastTurns.value.length, 0);
  welcome.value = { ...welcome.value, profile: { limits: { speed_cap: 100 } } };
  assert.deepEqual(
    macros.fastTurns.value.map((turn) => [turn.servoId, turn.end]),
    [
      [1, 90],
      [1, 0],
    ],
  );
  assert.equal(macros.secondsOfMacro(macros.macro.value), 1.5);
});

test("the preview stays within the macro, and ends at its end or begins again", () => {
  macros.startFromRobot();
  preview.seek(99);
  assert.equal(preview.time.value, 1.5);
  assert.deepEqual(preview.pose(), { 1: 0, 2: -30 });
  preview.togglePlay();
  assert.deepEqual([preview.isPlaying.value, preview.time.value], [true, 0]);
  const begin = performance.now();
  frame(begin + 500);
  assert.ok(Math.abs(preview.time.value - 0.5) < 0.1);
  frame(begin + 5000);
  assert.deepEqual([preview.isPlaying.value, preview.time.value], [false, 1.5]);
  preview.toggleLoop();
  preview.togglePlay();
  frame(begin + 60_000);
  assert.deepEqual([preview.isPlaying.value, preview.time.value], [true, 0]);
  preview.pause();
  assert.equal(preview.isPlaying.value, false);
  preview.toggleLoop();
});

test("before a macro runs, the robot is brought to the pose of the preview", () => {
  macros.startFromRobot();
  report({ 1: -50, 2: 20 });
  const { parts, lead } = preview.partsFrom(macros.course.value, 0);
  assert.equal(lead, 0.5); // 60 degrees at 120 degrees per second
  assert.deepEqual(parts[0], { at: 0, duration: 0.5, targets: { 1: 10 } });
  assert.deepEqual(
    parts.slice(1).map((part) => [part.at, part.duration, part.targets]),
    [
      [0.5, 0.5, { 1: 90 }],
      [0.5, 1, { 2: -30 }],
      [1.5, 0.5, { 1: 0 }],
    ],
  );
  const late = preview.partsFrom(macros.course.value, 1.2);
  assert.deepEqual(late.parts.at(-1).targets, { 1: 0 });
  assert.equal(late.parts.at(-1).duration, 0.3);
});

test("on the robot the preview shows the time of what was sent, and stops with it", async () => {
  macros.startFromRobot();
  preview.seek(0);
  let end;
  const motion = { begin: async () => true, play: () => new Promise((done) => (end = done)) };
  const run = preview.runOnRobot(motion);
  await turns();
  assert.equal(preview.isRunning.value, true);
  preview.seek(1);
  preview.togglePlay();
  assert.equal(preview.isPlaying.value, false);
  end(true);
  await run;
  assert.equal(preview.isRunning.value, false);
});

test("the timeline is as long as the macro with some room, and keeps its scale while a clip is stretched", () => {
  assert.ok(Math.abs(timeline.span.value - 1.59) < 1e-9);
  timeline.freezeScale();
  macros.insertCommand("delay", 5000);
  assert.ok(Math.abs(timeline.span.value - 1.59) < 1e-9);
  timeline.releaseScale();
  assert.ok(timeline.span.value > 6);
  assert.equal(timeline.share(timeline.span.value / 4), "25.000%");
  assert.match(timeline.place({ from: 0, until: 1 }).width, /^max\(3px, calc\(\d+\.\d{3}% - 2px\)\)$/);
});

test("the timeline is drawn at most eight times as wide as the screen", () => {
  assert.equal(timeline.isFarthest.value, true);
  for (let step = 0; step < 3; step++) timeline.zoomIn();
  assert.deepEqual([timeline.zoom.value, timeline.isNearest.value], [8, true]);
  for (let step = 0; step < 3; step++) timeline.zoomOut();
  assert.equal(timeline.zoom.value, 1);
  timeline.dragClip(0, 2);
  assert.deepEqual(timeline.endDrag(), { index: 0, to: 2 });
  assert.equal(timeline.endDrag(), null);
});

test("a press starts its macro, then the long press, and the release its own", () => {
  const ran = [];
  const button = { button_press_macro: 1, button_long_press_macro: 2, button_up_macro: 3, uninterruptible: 0 };
  const presses = new pad.Presses({ button: () => button, seconds: () => 0, run: (id) => ran.push(id) });
  presses.press(7);
  presses.press(7);
  assert.deepEqual([ran, [...pad.pressed.value]], [[1], [7]]);
  mock.timers.tick(800);
  presses.release(7);
  presses.release(7);
  assert.deepEqual([ran, pad.pressed.value.size], [[1, 2, 3], 0]);
  presses.press(7);
  presses.drop();
  mock.timers.tick(2000);
  presses.release(7);
  assert.deepEqual(ran, [1, 2, 3, 1]);
});

test("the macro of a release waits for an uninterruptible long press", () => {
  const ran = [];
  const button = { button_press_macro: 0, button_long_press_macro: 2, button_up_macro: 3, uninterruptible: 1 };
  const presses = new pad.Presses({ button: () => button, seconds: () => 2, run: (id) => ran.push(id) });
  presses.press(7);
  mock.timers.tick(800);
  presses.release(7);
  assert.deepEqual(ran, [2]);
  mock.timers.tick(2000);
  assert.deepEqual(ran, [2, 3]);
});

test("lost events of buttons are counted, and which buttons are down is known from the rest", () => {
  buttons.forgetButtons();
  const before = buttons.counts.value.lost;
  for (const kind of ["press", "long_press", "up"]) buttons.hear({ button_id: 4, kind });
  assert.equal(buttons.counts.value.lost, before);
  buttons.hear({ button_id: 4, kind: "up" });
  buttons.hear({ button_id: 4, kind: "press" });
  buttons.hear({ button_id: 4, kind: "press" });
  assert.equal(buttons.counts.value.lost, before + 2);
  assert.deepEqual([[...buttons.down.value], buttons.heard.value[0].kind], [[4], "press"]);
  buttons.forgetButtons();
  assert.equal(buttons.down.value.size, 0);
});

test("marks keep their pose, in the recording too while there is one", async () => {
  history.add(12.5, []);
  await recording.mark(link);
  assert.deepEqual(recording.marks.value.at(-1), { number: 1, time: 12.5, pose: { 1: 10, 2: 20 } });
  assert.deepEqual(link.asked, []);
  const started = recording.startOrStop(link);
  link.taken("recorder.start").resolve({ is_recording: true });
  await started;
  recording.mark(link);
  assert.equal(recording.marks.value.at(-1).number, 2);
  assert.ok(link.taken("recorder.mark"));
  const stopped = recording.startOrStop(link);
  link.taken("recorder.stop").resolve({ is_recording: false, file: "a.servolink" });
  await stopped;
  assert.equal(toasts.toasts.value.at(-1).detail, "a.servolink");
});

test("plots freeze with the readings of that moment, and leave out servos", () => {
  recording.freeze();
  const { count } = recording.frozen.value;
  history.add(13, []);
  assert.equal(recording.frozen.value.count, count);
  recording.freeze();
  assert.equal(recording.frozen.value, null);
  recording.plotServos([1], false);
  assert.deepEqual(recording.plotted.value, [2]);
  recording.plotServos([1], true);
  assert.deepEqual(recording.plotted.value, [1, 2]);
});

test("limbs are released, posed, held and saved as an action", async () => {
  teaching.toggleLimb("");
  assert.deepEqual(teaching.chosenIds.value, [1, 2]);
  const releasing = teaching.releaseLimbs(link);
  link.taken("lease.take").resolve({ lease: mine });
  await turns();
  for (const _ of [1, 2]) assert.deepEqual(link.asked[0].params.hold, (link.taken("servo.set").resolve({}), false));
  assert.equal(await releasing, true);
  teaching.takePose();
  assert.equal(teaching.film.value.length, 1);
  assert.equal(JSON.parse(sessionStorage.getItem("servolink.taught")).length, 1);
  teaching.choosePose(null);
  const answer = async (more) => {
    const { params, resolve } = link.taken("project.lesson");
    resolve({ seconds: [0.5], least_seconds: [0.3], refusal: "", actions: [], macros: [], ...more });
    await turns();
    return params;
  };
  const first = await answer({});
  assert.deepEqual(first.poses.map((pose) => pose.degrees), [{ 1: 10, 2: 20 }]); // prettier-ignore
  assert.deepEqual(
    [first.start, first.actions],
    [
      { 1: 10, 2: 20 },
      { 1: "up", 2: "down" },
    ],
  );
  assert.deepEqual([teaching.film.value[0].seconds, teaching.leastOf(0)], [0.5, 0.3]);
  teaching.nameLesson(" up ");
  assert.equal((await answer({ refusal: "name_taken" })).name, "up");
  assert.equal(teaching.problem.value, "teach.name_taken");
  assert.equal(teaching.maySave.value, false);
  teaching.nameLesson("salute");
  await answer({});
  assert.equal(JSON.parse(sessionStorage.getItem("servolink.taught_name")), "salute");
  const saving = teaching.saveLesson();
  for (let request; (request = link.taken("servo.set")); await turns()) request.resolve({});
  const salute = { action_id: 3, action_caption: "salute", steps: [] };
  await answer({ actions: [salute] });
  await saving;
  assert.equal(released.value.size, 0);
  assert.deepEqual([draft.value.actions.at(-1).action_caption, view.chosenAction.value], ["salute", 3]);
  assert.deepEqual([teaching.film.value, teaching.name.value], [[], ""]);
});

test("released servos are forgotten when somebody else holds them", async () => {
  const releasing = teaching.releaseLimbs(link);
  link.taken("lease.take").resolve({ lease: mine });
  await turns();
  for (let request; (request = link.taken("servo.set")); await turns()) request.resolve({});
  await releasing;
  report({ 1: 10, 2: 20 }, false);
  assert.equal(teaching.isLimp.value, true);
  report({ 1: 10, 2: 20 }, true);
  assert.equal(teaching.isLimp.value, false);
});

test("the preview of a film moves from pose to pose and ends", async () => {
  const taken = (angle) => ({ pose: { 1: angle }, ids: [1], seconds: 1, at: 0 });
  sessionStorage.setItem("servolink.taught", JSON.stringify([taken(0), taken(90)]));
  const teaching = await import(`${state}teaching.js?again`);
  teaching.togglePreview();
  const begin = performance.now();
  frame(begin + 1500);
  assert.ok(Math.abs(teaching.previewPose()[1] - 45) < 10);
  frame(begin + 5000);
  assert.equal(teaching.previewPose(), null);
  teaching.forgetLast();
  assert.deepEqual([teaching.film.value.length, teaching.chosenPose.value], [1, 0]);
});

test("a figure is fitted from itself: a servo changes places with the one that had the joint", () => {
  const joint = (id, servo) => ({ id, servo, axis: [0, 0, 1], at: [0, 0, 0] });
  ownFigure.value = { name: "two", joints: [joint("a", 1), joint("b", 2), joint("c", 3)], groups: {}, shapes: [] };
  fitting.beginFit();
  assert.deepEqual([fitting.origin.value, fitting.asked.value, fitting.nameOfFit()], [-1, 1, "two"]);
  assert.equal(fitting.jointOf(fitting.fit.value, 3), null); // this robot does not have it
  fitting.changeFit(fitting.assigned(fitting.fit.value, 1, "b"));
  assert.deepEqual(
    fitting.fit.value.data.joints.map((each) => each.servo),
    [2, 1, undefined],
  );
  const turned = fitting.changed(fitting.fit.value, "b", { sign: -1 });
  assert.equal(fitting.jointOf(turned, 1).sign, -1);
  assert.deepEqual(fitting.drawnPose(turned, { 1: 30, 2: 40 }), { 0: 40, 1: 30 });
  fitting.askAbout(2);
  assert.equal(fitting.asked.value, 2);
  fitting.endFit();
  assert.equal(fitting.fit.value, null);
  ownFigure.value = null;
});

test("messages go away by themselves, one replaces another of its name, and at most four are shown", () => {
  toasts.toasts.value = [];
  toasts.toast({ name: "edit", title: "first" });
  toasts.toast({ name: "edit", title: "second", lasts: 100 });
  assert.deepEqual(
    toasts.toasts.value.map((each) => each.title),
    ["second"],
  );
  mock.timers.tick(100);
  assert.deepEqual(toasts.toasts.value, []);
  for (let number = 0; number < 6; number++) toasts.toast({ title: String(number) });
  assert.equal(toasts.toasts.value.length, 4);
});

test("the button of a message undoes its edit, and nothing that came later", () => {
  actions.changeAction("actions.did_rename", (one) => ({ ...one, action_caption: "a" }));
  toasts.editToast({ title: "renamed" });
  const { run } = toasts.toasts.value.at(-1).action;
  actions.changeAction("actions.did_rename", (one) => ({ ...one, action_caption: "b" }));
  run();
  assert.equal(actions.action.value.action_caption, "b");
  undo();
  run();
  assert.equal(actions.action.value.action_caption, "up");
});

test("targets are drafted servo by servo, and dropped together", () => {
  view.draftTarget(1, 30);
  view.draftTarget(2, 40);
  assert.deepEqual(view.draft.value, { 1: 30, 2: 40 });
  view.dropTargets();
  assert.deepEqual(view.draft.value, {});
  view.lookFrom("live", "side");
  assert.deepEqual([view.views.live.value, view.views.macros.value], ["side", "free"]);
});
