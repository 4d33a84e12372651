// Life of a movement by hand: states, and the events between states (docs/design/studio.md).

/**
 * - `idle`: no control is held.
 * - `taking`: a control is held, and the hub was asked for the lease.
 * - `held`: a control is held, and the hub has given the lease.
 * - `ending`: the control was released, and the hub stops the servos that still turn.
 * - `waiting`: a control is held again before those servos are stopped; then the hub is asked for the lease.
 * @typedef {"idle" | "taking" | "held" | "ending" | "waiting"} State
 */
/**
 * - `pressed`: a control was pressed.
 * - `leased`: the hub has given the lease, perhaps late.
 * - `released`: the control was released, and no servo turns.
 * - `braking`: the control was released while servos turn.
 * - `braked`: the hub has stopped those servos.
 * - `dropped`: lease or connection is lost, the lease was refused, or somebody has stopped the robot.
 * @typedef {"pressed" | "leased" | "released" | "braking" | "braked" | "dropped"} Event
 */

/**
 * Next state by state and event; an event that is missing cannot happen in that state.
 * @type {Readonly<Record<State, Partial<Record<Event, State>>>>}
 */
export const TRANSITIONS = Object.freeze({
  idle: { pressed: "taking", leased: "idle", dropped: "idle" },
  taking: { pressed: "taking", leased: "held", released: "idle", braking: "ending", dropped: "idle" },
  held: { pressed: "taking", leased: "held", released: "idle", braking: "ending", dropped: "idle" },
  ending: { pressed: "waiting", leased: "ending", braked: "idle", dropped: "ending" },
  waiting: {
    pressed: "waiting",
    leased: "waiting",
    released: "ending",
    braking: "ending",
    braked: "taking",
    dropped: "ending",
  },
});

const HELD = /** @type {readonly State[]} */ (["taking", "held", "waiting"]);

/** State of the movements of one page. */
export class MotionState {
  /** @type {State} */
  #now = "idle";

  get now() {
    return this.#now;
  }

  /** Whether a control is held: nothing is sent otherwise. */
  get isHeld() {
    return HELD.includes(this.#now);
  }

  /**
   * Enter the next state after `event`. Throws if the event cannot happen now.
   * @param {Event} event
   */
  change(event) {
    const next = TRANSITIONS[this.#now][event];
    if (next === undefined) throw new Error(`internal error: the event ${event} in the state ${this.#now}`);
    this.#now = next;
  }
}
