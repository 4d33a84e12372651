// Mirror images of servos, left and right, with their angles: by the limbs of the figure, or without a figure by the
// captions of the servos, as `servolink/project/mirror.py` does.

/** @typedef {import("../figure/figure.js").Figure} Figure */
/** @typedef {import("../figure/figure.js").Joint} Joint */
/** @typedef {import("./records.js").Step} Step */
/** @typedef {{ id: number, angle: (degree: number) => number, isRight: boolean }} Image A servo's image, and its angle. */
/** @typedef {Map<number, Image>} Mirror */

/** @type {Record<string, string>} */
const OTHER = { left: "right", right: "left", l: "r", r: "l", 左: "右", 右: "左" };
const RIGHT = ["right", "r", "右"];

// A single letter is a side if no letter stands beside it (`L`, `l_knee`, `knee-R`, `L2`), or if capitals separate the
// words (`LKnee`, `kneeL`).
const LETTER = "[\\p{L}\\p{Nl}\\p{No}]";
const SIDE = new RegExp(
  `[Ll][Ee][Ff][Tt]|[Rr][Ii][Gg][Hh][Tt]|[左右]|(?<!${LETTER})[LRlr](?!${LETTER})|(?<!${LETTER})[LR](?=[A-Z][a-z])|(?<=[a-z])[LR](?!${LETTER})`,
  "gu",
);

/**
 * Return a caption with left and right exchanged, unchanged if it names no side.
 * @param {string} caption
 */
export const otherSide = (caption) => caption.replace(SIDE, (found) => withCaseOf(found, OTHER[found.toLowerCase()]));

/**
 * Return the mirror images of all servos with an image.
 * @param {Figure | null} figure
 * @param {readonly { servo_id: number, servo_caption: string }[]} parameters
 * @returns {Mirror}
 */
export function mirrorOf(figure, parameters) {
  return (figure && byFigure(figure)) ?? byCaptions(parameters);
}

/**
 * Return the mirror images of steps; a step of a servo without an image stays.
 * @param {readonly Step[]} steps
 * @param {Mirror} mirror
 * @returns {Step[]}
 */
export function mirrored(steps, mirror) {
  return steps.map((step) => {
    const image = mirror.get(step.servo_id);
    return image ? { ...step, servo_id: image.id, degree: image.angle(step.degree) } : step;
  });
}

/**
 * Return steps whose left half is the image of their right half.
 * @param {readonly Step[]} steps
 * @param {Mirror} mirror
 * @returns {Step[]}
 */
export function rightToLeft(steps, mirror) {
  const lefts = new Set([...mirror.values()].filter((image) => image.isRight).map((image) => image.id));
  const kept = steps.filter((step) => !lefts.has(step.servo_id));
  const rights = kept.filter((step) => mirror.get(step.servo_id)?.isRight);
  return [...kept, ...mirrored(rights, mirror)].sort((a, b) => a.servo_id - b.servo_id);
}

/**
 * @param {Figure} figure
 * @returns {Mirror | null}
 */
function byFigure(figure) {
  const groups = figure.data.groups ?? {};
  const joints = figure.joints.filter((joint) => joint.servo !== undefined);
  /** @type {Mirror} */
  const mirror = new Map();
  for (const [group, names] of Object.entries(groups)) {
    const other = Object.entries(groups).find(([key, { en }]) => key !== group && en === otherSide(names.en));
    if (other === undefined) continue;
    const mine = joints.filter((joint) => joint.group === group),
      theirs = joints.filter((joint) => joint.group === other[0]);
    mine.forEach((joint, at) => {
      const partner = theirs.find(({ id }) => id !== joint.id && id === otherSide(joint.id)) ?? theirs[at];
      if (partner?.servo !== undefined)
        mirror.set(joint.servo ?? 0, { id: partner.servo, ...rule(joint, partner), isRight: isRight(names.en) });
    });
  }
  if (mirror.size === 0) return null;
  for (const joint of joints) {
    const id = joint.servo ?? 0;
    if (!mirror.has(id)) mirror.set(id, { id, ...rule(joint, joint), isRight: false }); // a head or a waist
  }
  return mirror;
}

/**
 * Return the function from the angle of a joint to that of its image: a turn about the axis from side to side stays,
 * other turns are reversed.
 * @param {Joint} joint
 * @param {Joint} image
 */
function rule(joint, image) {
  const [x, y, z] = joint.axis,
    [a, b, c] = image.axis;
  const way = x * a - y * b - z * c >= 0 ? 1 : -1;
  return {
    angle: (/** @type {number} */ degree) =>
      Math.round((way * (joint.sign * degree + joint.offset) - image.offset) / image.sign) || 0,
  };
}

/**
 * @param {readonly { servo_id: number, servo_caption: string }[]} parameters
 * @returns {Mirror}
 */
function byCaptions(parameters) {
  /** @type {Mirror} */
  const mirror = new Map();
  for (const { servo_id, servo_caption } of parameters) {
    const image = otherSide(servo_caption);
    const partners = parameters.filter((other) => normalized(other.servo_caption) === normalized(image));
    const isOne =
      parameters.filter((other) => normalized(other.servo_caption) === normalized(servo_caption)).length === 1;
    if (image === servo_caption || partners.length !== 1 || !isOne) continue;
    mirror.set(servo_id, {
      id: partners[0].servo_id,
      angle: (degree) => -degree || 0,
      isRight: isRight(servo_caption),
    });
  }
  return mirror;
}

/** @param {string} caption */
const isRight = (caption) => RIGHT.includes((caption.match(SIDE)?.[0] ?? "").toLowerCase());

/** @param {string} caption */
const normalized = (caption) => caption.toLowerCase().split(/\s+/u).filter(Boolean).join(" ");

/**
 * @param {string} model
 * @param {string} word
 */
function withCaseOf(model, word) {
  if (model === model.toUpperCase() && model !== model.toLowerCase()) return word.toUpperCase();
  const isCapital = model[0] === model[0].toUpperCase() && model[0] !== model[0].toLowerCase();
  return isCapital ? word[0].toUpperCase() + word.slice(1) : word;
}
