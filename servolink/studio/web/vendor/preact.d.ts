// The part of Preact that the page uses.
export interface VNode {
  type: unknown;
  props: Record<string, unknown>;
}
export type Child = VNode | string | number | boolean | null | undefined | Child[];
export interface Context<T> {
  readonly standard: T;
  readonly Provider: unknown;
}
export function createContext<T>(standard: T): Context<T>;
export function h(type: unknown, props: object | null, ...children: unknown[]): VNode;
export function render(node: Child, parent: Element): void;
