// The last seconds of every servo, for plots: rings of numbers that are never copied.

/** @typedef {"angle" | "current_raw" | "temperature_raw"} Quantity */

/** Quantities in a reading of a servo, for plots. */
export const QUANTITIES = /** @type {const} */ (["angle", "current_raw", "temperature_raw"]);
/** Readings that are kept of each servo: a minute at 50 a second. */
export const LENGTH = 3000;

/** Readings of all servos with their times. */
export class History {
  constructor() {
    this.times = new Float64Array(LENGTH).fill(NaN);
    /** Number of readings that were added; the latest is at `(count - 1) % LENGTH`. */
    this.count = 0;
    /** @type {Map<number, Record<Quantity, Float32Array>>} */
    this._rings = new Map();
  }

  /**
   * Add one reading of all servos; values that cannot be true leave a gap.
   * @param {number} time seconds
   * @param {Iterable<{ servo_id: number, doubt?: string } & Record<Quantity, number>>} servos
   */
  add(time, servos) {
    const at = this.count % LENGTH;
    this.times[at] = time;
    for (const rings of this._rings.values()) for (const quantity of QUANTITIES) rings[quantity][at] = NaN;
    for (const servo of servos) {
      const rings = this.of(servo.servo_id);
      for (const quantity of QUANTITIES) rings[quantity][at] = servo.doubt ? NaN : servo[quantity];
    }
    this.count++;
  }

  /**
   * Return the rings of a servo.
   * @param {number} servoId
   */
  of(servoId) {
    let rings = this._rings.get(servoId);
    if (rings === undefined) {
      const ring = () => new Float32Array(LENGTH).fill(NaN);
      rings = { angle: ring(), current_raw: ring(), temperature_raw: ring() };
      this._rings.set(servoId, rings);
    }
    return rings;
  }

  /** Return the readings as they are now, in rings of their own. */
  copy() {
    const other = new History();
    other.times.set(this.times);
    other.count = this.count;
    for (const [id, rings] of this._rings)
      for (const quantity of QUANTITIES) other.of(id)[quantity].set(rings[quantity]);
    return other;
  }
}
