// Figure: joints and shapes of a robot, and their places in a pose. The format is in docs/reference/project-file.md.

import {
  AXES,
  apply,
  identity,
  multiply,
  normalize,
  placement,
  rigidInverse,
  rotation,
  subtract,
  translation,
} from "./matrix.js";

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./matrix.js").Matrix} Matrix */
/** @typedef {"shell" | "limb" | "dark" | "glow"} Tone */
/** @typedef {{ box: Vector, at?: Vector, round?: number, tone?: Tone }} Box */
/** @typedef {{ disc: [number, number], axis?: "x" | "y" | "z", at?: Vector, tone?: Tone }} Disc Radius and length. */
/** @typedef {{ mode: "fixed", at?: Vector } | { mode: "feet", feet: [string, string], sole: Vector }} Base */
/** @typedef {{ yaw: number, pitch: number, distance: number, target: Vector, floor?: number }} View */
/**
 * Joint of the file: `sign * degrees of the servo + offset` about `axis`, at `at` in the frame of the parent.
 * @typedef {object} JointData
 * @property {string} id
 * @property {string} [parent]
 * @property {number} [servo]
 * @property {number} [follows] the servo whose angle it copies
 * @property {string} [group]
 * @property {Vector} [at]
 * @property {"x" | "y" | "z" | Vector} [axis]
 * @property {number} [sign]
 * @property {number} [offset]
 * @property {[number, number]} [limits] degrees of the servo
 * @property {number} [length]
 * @property {Vector} [along]
 * @property {number} [width]
 * @property {Vector} [tip] the point that a drag pulls
 * @property {(Box | Disc)[]} [shapes]
 */
/** @typedef {{ name: string, view: View, base?: Base, groups?: Record<string, Record<string, string>>, joints: JointData[] }} FigureData */
/** Figure with physics: how its base has moved (millimetres) and turned (quaternion w, x, y, z). @typedef {{ pose: Pose, move: Vector, turn: [number, number, number, number] }} Body */
/** @typedef {Record<number, number>} Pose Degrees by servo id; a servo that is missing is at 0. */
/**
 * @typedef {object} Joint
 * @property {string} id
 * @property {number} parent its index, -1 for none
 * @property {number | undefined} servo
 * @property {number | undefined} follows
 * @property {string} group
 * @property {Vector} at
 * @property {Vector} axis
 * @property {number} sign
 * @property {number} offset
 * @property {[number, number]} limits
 * @property {Vector} tip
 * @property {(Box | Disc)[]} shapes
 */

const BOTH_DOWN = 3; // millimetres by which the higher foot may be above the floor
const SAME = 1e-6;
const DOWN = /** @type {Vector} */ ([0, -1, 0]);

/** The joints of a robot, ready to be turned. */
export class Figure {
  /** @param {FigureData} data checked by the server: no cycles, each parent before its children */
  constructor(data) {
    this.data = data;
    /** @type {Map<string, number>} */
    this.indexes = new Map(data.joints.map((joint, index) => [joint.id, index]));
    this.joints = data.joints.map((joint) => this._joint(joint));
    /** @type {Map<number, Joint>} */
    this.byServo = new Map();
    for (const joint of this.joints) if (joint.servo !== undefined) this.byServo.set(joint.servo, joint);
    this.servoIds = [...this.byServo.keys()].sort((a, b) => a - b);
    /** @type {Base} */
    this.base = data.base ?? { mode: "fixed" };
    const base = this.base;
    const atRest = this._chain({}, identity());
    this._soles = base.mode === "feet" ? base.feet.map((foot) => apply(atRest[this.indexOf(foot)], base.sole)) : [];
  }

  /** @param {string} id */
  indexOf(id) {
    return /** @type {number} */ (this.indexes.get(id));
  }

  /**
   * Return whether a joint ends a limb, as hands, feet and heads do: no servo turns a part of it.
   * @param {Joint} joint
   */
  isEnd(joint) {
    const under = new Set([joint]);
    for (const one of this.joints) if (under.has(this.joints[one.parent])) under.add(one);
    const isTurned = [...under].some((one) => one !== joint && one.servo !== undefined);
    return !isTurned && (joint.servo !== undefined || (joint.parent >= 0 && this.base.mode === "feet"));
  }

  /**
   * Return the matrix of each joint. A figure on feet stands on the floor: its lower foot stays flat where it was, so
   * that a bow bends the body and not the floor.
   * @param {Pose} pose
   * @returns {Matrix[]}
   */
  solve(pose) {
    return this._chain(pose, this.rootOf(pose));
  }

  /**
   * Return the matrix of the base.
   * @param {Pose} pose
   * @returns {Matrix}
   */
  rootOf(pose) {
    const base = this.base;
    if (base.mode === "fixed") return translation(base.at ?? [0, 0, 0]);
    const free = this._chain(pose, identity());
    const feet = base.feet.map((foot) => free[this.indexOf(foot)]);
    const stands = feet.map((foot, index) => this._stand(feet, foot, index, base.sole));
    const lower = stands.filter((stand) => stand.isLower);
    const used = lower.length > 0 ? lower : [stands[0].depth < stands[1].depth ? stands[0] : stands[1]];
    // A foot tilted by a bent knee would be the lower end of a lying body: keep the body upright.
    const best = used.reduce((one, other) => (other.upright > one.upright + SAME ? other : one));
    let move = best.move;
    if (used.length === 2 && used.every((stand) => stand.lift < BOTH_DOWN)) {
      const mean = (/** @type {0 | 1 | 2} */ axis) => (used[0].move[axis] + used[1].move[axis]) / 2;
      move = [mean(0), mean(1), mean(2)]; // of both places, so that nothing jumps when the weight changes
    }
    const root = best.turn.slice();
    [root[12], root[13], root[14]] = move;
    return root;
  }

  /**
   * Return the matrix of each joint of a figure whose base is moved and turned from where it is at rest.
   * @param {Body} body
   */
  place({ pose, move, turn }) {
    const base = this.base;
    const [x, y, z] =
      base.mode === "fixed" ? (base.at ?? [0, 0, 0]) : [0, -Math.min(...this._soles.map((at) => at[1])), 0];
    return this._chain(pose, placement(turn, [x + move[0], y + move[1], z + move[2]]));
  }

  /**
   * Return how the figure stands on one foot.
   * @param {Matrix[]} feet
   * @param {Matrix} foot
   * @param {number} index
   * @param {Vector} sole
   */
  _stand(feet, foot, index, sole) {
    const turn = rigidInverse(foot);
    turn[12] = turn[13] = turn[14] = 0;
    const soles = feet.map((each) => apply(turn, apply(each, sole)));
    const depth = soles[index][1];
    const move = subtract(this._soles[index], soles[index]);
    return {
      turn,
      depth,
      move: /** @type {Vector} */ ([move[0], -depth, move[2]]),
      isLower: soles.every((other) => other[1] >= depth - 0.01),
      upright: turn[5], // the cosine of the angle by which the body leans
      lift: Math.max(0, ...soles.map((other) => other[1] - depth)),
    };
  }

  /**
   * @param {Pose} pose
   * @param {Matrix} root
   * @returns {Matrix[]}
   */
  _chain(pose, root) {
    /** @type {Matrix[]} */
    const matrices = [];
    for (const joint of this.joints) {
      const driver = joint.servo ?? joint.follows;
      const degrees = joint.sign * (driver === undefined ? 0 : (pose[driver] ?? 0)) + joint.offset;
      const unturned = multiply(joint.parent < 0 ? root : matrices[joint.parent], translation(joint.at));
      matrices.push(degrees ? multiply(unturned, rotation(joint.axis, degrees)) : unturned);
    }
    return matrices;
  }

  /**
   * @param {JointData} data
   * @returns {Joint}
   */
  _joint(data) {
    const along = data.along ?? DOWN,
      length = data.length ?? 40;
    return {
      id: data.id,
      parent: data.parent === undefined ? -1 : this.indexOf(data.parent),
      servo: data.servo,
      follows: data.follows,
      group: data.group ?? "",
      at: data.at ?? [0, 0, 0],
      axis: typeof data.axis === "object" ? normalize(data.axis) : AXES[data.axis ?? "x"],
      sign: data.sign ?? 1,
      offset: data.offset ?? 0,
      limits: data.limits ?? [-180, 180],
      tip: data.tip ?? [along[0] * length, along[1] * length, along[2] * length],
      shapes: data.shapes ?? (data.length === undefined ? [] : [plainLimb(along, data.length, data.width ?? 26)]),
    };
  }
}

/**
 * Return the shape of a joint for which only a length is given.
 * @param {Vector} along
 * @param {number} length
 * @param {number} width
 * @returns {Box}
 */
function plainLimb(along, length, width) {
  const size = /** @type {Vector} */ (along.map((c) => Math.abs(c) * length + (1 - Math.abs(c)) * width));
  const at = /** @type {Vector} */ (along.map((c) => (c * length) / 2));
  return { box: size, at, round: width * 0.4, tone: "limb" };
}
