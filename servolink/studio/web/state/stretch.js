// The latest readings for a plot, thinned out: of readings that lie too close together, the lowest and the highest.

import { LENGTH } from "./history.js";

/** @typedef {import("./history.js").History} History */

/** Stretch of the latest readings, thinned out to a number of points. */
export class Stretch {
  /**
   * @param {History} history
   * @param {number} seconds
   * @param {number} points as many as can be told apart
   */
  constructor(history, seconds, points) {
    const { count, times } = history;
    this._latest = count > 0 ? times[(count - 1) % LENGTH] : 0;
    let first = Math.max(0, count - LENGTH);
    while (first < count && times[first % LENGTH] < this._latest - seconds) first++;
    this._group = count - first > points ? Math.ceil((2 * (count - first)) / points) : 1;
    this._first = Math.ceil(first / this._group) * this._group; // so that a group stays the same as it moves along
    this._end = count;
  }

  /**
   * Return the time of each point, seconds before the latest reading.
   * @param {Float64Array} ring
   */
  times(ring) {
    return this._pairs((from, until) => [
      ring[from % LENGTH] - this._latest,
      ring[(until - 1) % LENGTH] - this._latest,
    ]);
  }

  /**
   * Return the value of each point.
   * @param {Float32Array} ring
   */
  values(ring) {
    return this._pairs((from, until) => {
      let low = from,
        high = from;
      for (let at = from + 1; at < until; at++) {
        const value = ring[at % LENGTH];
        if (!(value >= ring[low % LENGTH])) low = at;
        if (!(value <= ring[high % LENGTH])) high = at;
      }
      return [ring[Math.min(low, high) % LENGTH], ring[Math.max(low, high) % LENGTH]];
    });
  }

  /** @param {(from: number, until: number) => [number, number]} pairOf */
  _pairs(pairOf) {
    const groups = Math.ceil((this._end - this._first) / this._group),
      size = this._group === 1 ? 1 : 2;
    const found = new Float64Array(groups * size);
    for (let at = 0, from = this._first; at < groups; at++, from += this._group) {
      const [early, late] = pairOf(from, Math.min(this._end, from + this._group));
      found[at * size] = early;
      if (size === 2) found[at * size + 1] = late;
    }
    return found;
  }
}

/**
 * Return the ends of a scale: round numbers around all values, and at least `span` apart.
 * @param {number | null} low lowest value, null without values
 * @param {number | null} high highest value
 * @param {number} span
 * @returns {[number, number]}
 */
export function scaleOf(low, high, span) {
  if (low === null || high === null) return [-span / 2, span / 2];
  const step = Math.max(span, high - low) / 4,
    unit = 10 ** Math.floor(Math.log10(step));
  const round = unit * ([1, 2, 3, 5].find((factor) => factor * unit >= step) ?? 10);
  const missing = Math.max(0, span - (high - low)) / 2;
  return [Math.floor((low - missing) / round) * round, Math.ceil((high + missing) / round) * round];
}
