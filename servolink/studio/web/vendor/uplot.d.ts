// The part of uPlot that the page uses.
export interface Options {
  width: number;
  height: number;
  [option: string]: unknown;
}
export default class uPlot {
  constructor(options: Options, data: ArrayLike<number | null>[], parent: HTMLElement);
  setData(data: ArrayLike<number | null>[], resetScales?: boolean): void;
  setSize(size: { width: number; height: number }): void;
  /** CSS pixels. */
  readonly width: number;
  setScale(key: string, range: { min: number; max: number }): void;
  readonly ctx: CanvasRenderingContext2D;
  /** Of the lines, in pixels of the canvas. */
  readonly bbox: { left: number; top: number; width: number; height: number };
  valToPos(value: number, key: string, isOfCanvas: boolean): number;
  destroy(): void;
}
