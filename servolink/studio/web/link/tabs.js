// Other tabs of the page. One tab has the robot at a port; the others watch and stop this robot over a channel. The studio in
// the worker gives each of them a line with the role of a link that watches. Messages carry the receiver, or an empty text for
// all tabs, the sender, a kind and a text:
//
// | to the tab with the robot | text | from the tab with the robot | text |
// | --- | --- | --- | --- |
// | ask | | robot | name and address, as JSON |
// | watch | greeting | message | message of the studio |
// | message | message of the tab | close | code and reason, as JSON |
// | close, stop | | | |

import { effect } from "../html.js";
import { isInPage, tellOffer, tellTabClosed, tellTabGone, watched } from "../state/connecting.js";
import { welcome } from "../state/robot.js";
import { PageLine } from "./page-line.js";
import { onStop, stopPorts, WorkerLine } from "./worker-line.js";

const GONE = 1001; // code of a line to a tab that has ended
const here = Math.random().toString(36).slice(2);
/** @type {BroadcastChannel | null} */
let channel = null;
/** Line to the watched tab. @type {TabLine | null} */
let own = null;
/** Lines of the tabs that watch the robot of this tab. @type {Map<string, WorkerLine>} */
const lines = new Map();
/** @type {() => void} */
let begin = () => {};
const begun = new Promise((/** @type {(value: void) => void} */ resolve) => (begin = resolve));

const post = (/** @type {string} */ to, /** @type {string} */ kind, text = "") =>
  channel?.postMessage([to, here, kind, text]);
// The browser frees the lock of a tab in whatever way the tab ends.
const lockOf = (/** @type {string} */ tab) => `servolink tab ${tab}`;
const whenGone = (/** @type {string} */ tab, /** @type {() => void} */ then) =>
  void navigator.locks.request(lockOf(tab), then);

/** Talk with the other tabs until this tab ends. A page without https has neither ports nor locks. */
export function followTabs() {
  if (!isInPage || !navigator.locks) return;
  channel = new BroadcastChannel("servolink");
  channel.onmessage = ({ data: [to, from, kind, text] }) => {
    if (to === "" || to === here) (watched ? hearWatched : hear)(from, kind, text);
  };
  navigator.locks.request(lockOf(here), () => {
    begin();
    if (watched) follow(watched.tab);
    else effect(tellRobot);
    post("", "ask");
    return new Promise(() => {});
  });
}

/** @param {string} tab */
function follow(tab) {
  onStop(() => post(tab, "stop"));
  whenGone(tab, () => {
    tellTabClosed();
    own?.heard("close", JSON.stringify({ code: GONE, reason: "" }));
  });
}

/** Tell the other tabs the robot at a port of this tab, if there is one. */
function tellRobot() {
  const { name = "", url = "", is_virtual: isVirtual = true } = welcome.value ?? {};
  if (!isVirtual) post("", "robot", JSON.stringify({ name, url }));
}

/** @param {string} from @param {string} kind @param {string} text */
function hearWatched(from, kind, text) {
  if (from === watched?.tab && (kind === "message" || kind === "close")) own?.heard(kind, text);
}

/** @param {string} from @param {string} kind @param {string} text */
function hear(from, kind, text) {
  if (kind === "ask") tellRobot();
  else if (kind === "robot") offer(from, text);
  else if (kind === "watch") admit(from, text);
  else if (kind === "message") lines.get(from)?.send(text);
  else if (kind === "close") drop(from);
  else if (kind === "stop") stopPorts();
}

/** @param {string} tab @param {string} text */
function offer(tab, text) {
  tellOffer({ ...JSON.parse(text), tab });
  whenGone(tab, () => tellTabGone(tab));
}

/** @param {string} tab @param {string} greeting */
function admit(tab, greeting) {
  drop(tab);
  const line = new WorkerLine("watch");
  lines.set(tab, line);
  line.onopen = () => line.send(greeting);
  line.onmessage = ({ data }) => post(tab, "message", data);
  line.onclose = (end) => post(tab, "close", JSON.stringify(end));
  whenGone(tab, () => drop(tab));
}

/** @param {string} tab */
function drop(tab) {
  lines.get(tab)?.close();
  lines.delete(tab);
}

/** Connection of this tab to the studio of the watched tab. */
export class TabLine extends PageLine {
  constructor() {
    super("watch", (kind, text) => post(watched?.tab ?? "", kind, text));
    own = this;
    begun.then(() => this.onopen?.());
  }
}
