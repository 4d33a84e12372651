// What components are written with, from the libraries in `vendor`.

import htm from "./vendor/htm.js";
import { createContext, h, render } from "./vendor/preact.js";

/** Tag of templates, which makes elements of Preact without a build. */
export const html = htm.bind(h);
export { createContext, render };
export {
  useCallback,
  useContext,
  useEffect,
  useLayoutEffect,
  useMemo,
  useRef,
  useState,
} from "./vendor/preact-hooks.js";
export { batch, computed, effect, signal, useComputed, useSignal, useSignalEffect } from "./vendor/signals.js";
