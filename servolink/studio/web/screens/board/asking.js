// Asks the studio for something when a card is shown, and again when the person wants it.

import { useEffect, useState } from "../../html.js";
import { isLive, linkState, welcome } from "../../state/robot.js";

/** @typedef {import("../../link/link.js").Link} Link */
/**
 * @template T
 * @typedef {{ answer: T | null, error: string, isAsking: boolean, ask: () => Promise<void> }} Asked
 */

/**
 * Return the latest answer to a request that only pages with the role edit may make, and what asks again.
 * @template T
 * @param {Link} link
 * @param {string} method
 * @param {() => object} params
 * @returns {Asked<T>}
 */
export function useAnswer(link, method, params) {
  const [answer, setAnswer] = useState(/** @type {T | null} */ (null));
  const [error, setError] = useState("");
  const [isAsking, setAsking] = useState(false);
  const ask = async () => {
    setAsking(true);
    try {
      setAnswer(await link.call(method, params()));
      setError("");
    } catch (failure) {
      setError(failure instanceof Error ? failure.message : String(failure));
    }
    setAsking(false);
  };
  const mayAsk = linkState.value === "open" && welcome.value?.role === "edit",
    isConnected = isLive.value;
  useEffect(() => {
    if (mayAsk) ask();
  }, [mayAsk, isConnected]);
  return { answer, error, isAsking, ask };
}
