// The hooks that the page uses.
import { Context } from "./preact.js";
type End = void | (() => void);
export function useState<T>(first: T | (() => T)): [T, (next: T | ((before: T) => T)) => void];
export function useContext<T>(context: Context<T>): T;
export function useRef<T>(first: T): { current: T };
export function useEffect(run: () => End, inputs?: readonly unknown[]): void;
export function useLayoutEffect(run: () => End, inputs?: readonly unknown[]): void;
export function useMemo<T>(make: () => T, inputs: readonly unknown[]): T;
export function useCallback<T extends (...given: never[]) => unknown>(call: T, inputs: readonly unknown[]): T;
