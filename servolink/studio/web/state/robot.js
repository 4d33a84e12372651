// Robot as known to the page: signals that follow the notifications of the studio.

import { batch, computed, signal } from "../html.js";
import { forgetButtons, hear } from "./button-events.js";
import { History } from "./history.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("../link/link.js").LinkState} LinkState */
/** @typedef {import("../link/link.js").Welcome} Welcome */
/** @typedef {{ servo_id: number, angle: number, current_raw: number, temperature_raw: number, is_start: boolean, is_hold: boolean, doubt?: string }} Servo */
/** @typedef {{ session: string, who: string, since: number, dead_man: number | null }} Lease */
/** @typedef {{ session: string, who: string, reason: string }} Hold */
/** @typedef {{ session: string, who: string, door: string, role: string }} Program */

const HZ = 50;
const BATTERY_EVERY = 30_000; // milliseconds

/** State of the connection between page and studio. */
export const linkState = signal(/** @type {LinkState} */ ("connecting"));
/** Greeting of the studio; null before the first connection. */
export const welcome = signal(/** @type {Welcome | null} */ (null));
/** Whether the hub has the board. */
export const boardState = signal(/** @type {"connected" | "lost" | "closed"} */ ("connected"));
/** Name of a board in place of the lost board; else empty. */
export const another = signal("");
/** Lease of the robot with session and name; null while free. */
export const lease = signal(/** @type {Lease | null} */ (null));
/** Exclusive use of the board by a program; null without exclusive use. */
export const hold = signal(/** @type {Hold | null} */ (null));
/** Latest problem reported by the hub; empty after a dismissal. */
export const problem = signal("");
/** Servo whose stall made the guard stop the robot, until the next stop; null for none. */
export const stalled = signal(/** @type {number | null} */ (null));
/** Programs connected to the hub, pages included. */
export const programs = signal(/** @type {Program[]} */ ([]));
/** The latest reading, by servo id. It is replaced as a whole, up to 50 times a second. */
export const servos = signal(/** @type {Map<number, Servo>} */ (new Map()));
/** Whether the servos were read since the page was connected to the studio, and the studio to the board. */
export const isRead = signal(false);
/** When the latest reading came, milliseconds of `performance.now()`. */
export const readAt = signal(0);
/** Percent; null where the board does not know it. */
export const battery = signal(/** @type {number | null} */ (null));
/** Captions of servos, as the board has them. */
export const captions = signal(/** @type {Record<number, string>} */ ({}));

/** Readings of the last seconds, for the plots. */
export const history = new History();

/** The ids of the servos; changes only when they do. */
export const servoIds = signal(/** @type {number[]} */ ([]));

/** Whether the page has the lease of the robot. */
export const isMine = computed(() => lease.value !== null && lease.value.session === welcome.value?.session);
/** Whether another program or page has the lease. */
export const isOthers = computed(() => lease.value !== null && !isMine.value);
/** Whether the studio shares boards with other programs; for pages without a board. */
export const sharesBoards = signal(false);
/** Whether the studio uses a board. */
export const hasBoard = computed(() => welcome.value?.name !== "");
/** Whether this page may edit the draft and the board. */
export const mayEdit = computed(() => welcome.value?.role === "edit");
/** Whether the studio sees a fleet. */
export const hasFleet = computed(() => welcome.value?.has_fleet === true);
/** Whether this page may choose robots, and change limits, figure and files of the computer: no link opened it. */
export const isLocalEditor = computed(() => welcome.value?.role === "edit" && !welcome.value.is_link);
/** Whether readings of the robot arrive at present. */
export const isLive = computed(() => linkState.value === "open" && boardState.value === "connected" && hasBoard.value);
/** Whether the latest reading says how the robot is now. */
export const isFresh = computed(() => isLive.value && isRead.value);
/** Whether this page may move the robot at all. */
export const mayMove = computed(() => ["move", "edit"].includes(welcome.value?.role ?? "watch"));

/**
 * Keep the signals up to date from now on, and call `onLease` with each notice of the lease, and whether it was ours.
 * @param {Link} link
 * @param {(notice: { event: string, by: string | null }, wasMine: boolean) => void} onLease
 */
export function follow(link, onLease) {
  link.onState = (state) => (linkState.value = state);
  link.onWelcome = (first) => begin(link, first);
  link.on("servos", (frame) => {
    take(frame);
    link.tell("servos.ack", { number: frame.number });
  });
  link.on("connection", (now) => {
    batch(() => {
      boardState.value = now.state;
      isRead.value = false; // somebody may have turned the servos, or changed the board
      another.value = now.another;
    });
    if (now.state === "connected") watchBattery(link); // it could not be asked meanwhile
  });
  link.on("lease", (notice) => {
    const wasMine = isMine.value;
    lease.value = notice.lease;
    onLease(notice, wasMine);
  });
  link.on("hold", (notice) => (hold.value = notice.hold));
  link.on("problem", ({ text }) => (problem.value = text));
  link.on("button", hear);
  link.on("program", () => refresh(link));
}

/**
 * Ask for everything: the connection is new.
 * @param {Link} link
 * @param {Welcome} first
 */
async function begin(link, first) {
  welcome.value = first;
  isRead.value = false;
  problem.value = "";
  forgetButtons();
  if (!hasBoard.value) return;
  await refresh(link);
  await Promise.allSettled([link.call("servos.watch", { hz: HZ }), link.call("buttons.subscribe"), readStored(link)]);
}

/**
 * Read captions and battery: they change seldom.
 * @param {Link} link
 */
async function readStored(link) {
  const { servos: stored } = await link.call("servos.parameters");
  captions.value = Object.fromEntries(stored.map((/** @type {any} */ one) => [one.servo_id, one.servo_caption]));
  await watchBattery(link);
}

let batteryTimer = 0;

/** @param {Link} link */
async function watchBattery(link) {
  clearInterval(batteryTimer);
  batteryTimer = setInterval(() => readBattery(link), BATTERY_EVERY);
  await readBattery(link);
}

/** @param {Link} link */
async function readBattery(link) {
  const found = await link.call("battery").catch(() => null);
  battery.value = found === null ? null : found.percent;
  if (found === null) clearInterval(batteryTimer); // this board does not know, or the connection begins again
}

/** @param {Link} link */
async function refresh(link) {
  const status = await link.call("status").catch(() => null);
  if (status === null) return; // the connection was lost, and begins again
  batch(() => {
    boardState.value = status.state;
    another.value = status.another ?? ""; // not told by the hub of an earlier version
    lease.value = status.lease;
    hold.value = status.hold;
    programs.value = status.programs;
  });
}

const TREMBLES = 1; // degrees by which a servo that rests differs from where it came to rest
const RESTS = 1000; // milliseconds without a turn, after which a servo rests
let turnedAt = -Infinity; // milliseconds of `performance.now()`
/** Angle of each servo when it turned last; two readings in a row hardly differ while a servo turns slowly. */
const restsAt = /** @type {Map<number, number>} */ (new Map());

/** Return whether no servo has turned lately. */
export const isStill = () => performance.now() - turnedAt > RESTS;

/** @param {{ seconds: number, servos: Servo[] }} frame */
function take(frame) {
  const turned = frame.servos.filter(
    ({ servo_id: id, angle }) => !(Math.abs(angle - (restsAt.get(id) ?? NaN)) <= TREMBLES),
  );
  for (const { servo_id: id, angle } of turned) restsAt.set(id, angle);
  if (!isRead.peek() || turned.length > 0) turnedAt = performance.now();
  history.add(frame.seconds, frame.servos);
  const ids = frame.servos.map((servo) => servo.servo_id).sort((a, b) => a - b);
  batch(() => {
    readAt.value = performance.now();
    isRead.value = true;
    servos.value = new Map(frame.servos.map((servo) => [servo.servo_id, servo]));
    if (ids.join() !== servoIds.value.join()) servoIds.value = ids;
  });
}

/** Return the angles that the servos report now, for drawing. */
export const actualPose = () =>
  Object.fromEntries([...servos.value.values()].map((servo) => [servo.servo_id, servo.angle]));

/** @param {boolean} shares whether the studio shares a board, shown or not */
export const noteShared = (shares) => void (sharesBoards.value = shares);

/** Hide the latest problem that the hub has reported. */
export function dismissProblem() {
  problem.value = "";
}
