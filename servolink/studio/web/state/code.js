// The program of the screen Code: its text, what it printed, and how it ended.

import { signal } from "../html.js";
import { Programs } from "../link/programs.js";
import { onStop } from "../link/worker-line.js";
import { forBrowser } from "./storage.js";

/** @typedef {import("../link/programs.js").End} End */
/** @typedef {import("../link/programs.js").Failure} Failure */

const KEY = "servolink.program";
const MOST = 10_000; // characters of output that are shown

/** Text of the program; null before one was chosen. */
export const program = signal(forBrowser.get(KEY));
/** The end of what the latest program has printed. */
export const output = signal("");
/** Whether a worker waits for a program. */
export const isReady = signal(false);
/** How the latest program goes, or has ended; empty before the first. */
export const course = signal(/** @type {End | "running" | ""} */ (""));
/** Error that ended the latest program. */
export const mistake = signal(/** @type {Failure | null} */ (null));

const programs = new Programs({
  onReady: (is) => void (isReady.value = is),
  onOutput: (text) => void (output.value = (output.value + text).slice(-MOST)),
  onEnd: (end, failure) => {
    course.value = end;
    mistake.value = failure;
  },
});
let asked = 0; // number of the latest Run, Stop or STOP
onStop(stopProgram);

/** Start the worker of the next program. */
export const prepareProgram = () => programs.prepare();
/** End the program that runs, or is about to. */
export function stopProgram() {
  asked++;
  programs.stop();
}

/** Keep the text of the program, which nothing but `runProgram` runs. @param {string} text */
export function changeProgram(text) {
  program.value = text;
  forBrowser.set(KEY, text);
}

/** Run the program, once the robot may be moved. @param {import("./motion.js").Motion} motion */
export async function runProgram(motion) {
  const text = program.value ?? "";
  output.value = "";
  mistake.value = null;
  course.value = "";
  const mine = ++asked;
  await motion.makeWay();
  if (mine !== asked) return;
  course.value = "running";
  programs.run(text);
}
