// Names of the parts of figures: words of the ids of joints, such as `r_shoulder`.

import { language, LANGUAGES } from "./text.js";

/** English, Simplified and Traditional Chinese. */
const WORDS = new Map(
  Object.entries({
    r: ["right", "右", "右"],
    l: ["left", "左", "左"],
    rf: ["right front", "右前", "右前"],
    rm: ["right middle", "右中", "右中"],
    rr: ["right rear", "右后", "右後"],
    lf: ["left front", "左前", "左前"],
    lm: ["left middle", "左中", "左中"],
    lr: ["left rear", "左后", "左後"],
    ankle: ["ankle", "踝", "踝"],
    arm: ["arm", "上臂", "上臂"],
    base: ["base", "底座", "底座"],
    body: ["body", "身体", "身體"],
    elbow: ["elbow", "肘", "肘"],
    foot: ["foot", "脚", "腳"],
    head: ["head", "头", "頭"],
    hip: ["hip", "髋", "髖"],
    jaw: ["jaw", "夹爪", "夾爪"],
    knee: ["knee", "膝", "膝"],
    pelvis: ["pelvis", "骨盆", "骨盆"],
    roll: ["roll", "腕部旋转", "腕部旋轉"],
    shin: ["shin", "小腿", "小腿"],
    shoulder: ["shoulder", "肩", "肩"],
    tail: ["tail", "尾巴", "尾巴"],
    thigh: ["thigh", "大腿", "大腿"],
    torso: ["torso", "躯干", "軀幹"],
    wrist: ["wrist", "腕", "腕"],
    yaw: ["yaw", "水平旋转", "水平旋轉"],
  }),
);

/**
 * Return the name of a part in the language of the page; unknown words stay.
 * @param {string} id of a joint
 */
export function partName(id) {
  const at = Object.keys(LANGUAGES).indexOf(language.value),
    words = id.split("_");
  const isKnown = words.every((word) => WORDS.has(word));
  return words.map((word) => WORDS.get(word)?.[at] ?? word).join(at > 0 && isKnown ? "" : " ");
}
