// A gamepad at this computer presses the buttons of the pad.

import { useEffect } from "../../html.js";
import { safeText } from "../../parts/safe-text.js";
import { nameGamepad } from "../../state/pad.js";
import { BY_GAMEPAD } from "./layout.js";

/**
 * Call `onPress` and `onRelease` with the ids of buttons while the component is shown and the page is in front. Buttons
 * that are down before that are not pressed. Call `onLost` if the gamepad is gone while a button is down.
 * @param {(id: number) => void} onPress
 * @param {(id: number) => void} onRelease
 * @param {() => void} onLost
 */
export function useGamepad(onPress, onRelease, onLost) {
  useEffect(() => {
    /** @type {Set<number>} */
    let before = new Set();
    let frame = 0,
      isFirst = true;
    const look = () => {
      frame = requestAnimationFrame(look);
      const gamepad = navigator.getGamepads().find((each) => each?.connected && each.mapping === "standard");
      const name = safeText(gamepad?.id ?? "");
      nameGamepad(name);
      const now = new Set(downOn(gamepad));
      if (gamepad === undefined && before.size > 0) onLost();
      else if (!isFirst && document.hasFocus()) {
        for (const id of now) if (!before.has(id)) onPress(id);
        for (const id of before) if (!now.has(id)) onRelease(id);
      }
      before = now;
      isFirst = false;
    };
    look();
    return () => cancelAnimationFrame(frame);
  }, []);
}

/** @param {Gamepad | null | undefined} gamepad */
const downOn = (gamepad) =>
  (gamepad?.buttons ?? []).flatMap((button, number) =>
    button.pressed && number in BY_GAMEPAD ? [BY_GAMEPAD[number]] : [],
  );
