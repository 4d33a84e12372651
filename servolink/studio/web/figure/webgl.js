// Draws figures with WebGL2. A hidden canvas draws all figures of the page, then copied to canvases of their
// own: browsers allow only a few contexts.

import { apply } from "./matrix.js";
import { meshOf } from "./mesh.js";
import { palette } from "./palette.js";
import { BODY_FRAGMENT, BODY_VERTEX, FLOOR_FRAGMENT, FLOOR_VERTEX, MOST_SHADOWS } from "./shaders.js";

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./matrix.js").Matrix} Matrix */
/** @typedef {import("./figure.js").Figure} Figure */
/** @typedef {import("./figure.js").Joint} Joint */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {{ tint: Vector, amount: number }} Tint */
/**
 * One pose of the figure; several are drawn over each other.
 * @typedef {object} Layer
 * @property {Matrix[]} matrices
 * @property {number} [alpha] below 1 for a ghost
 * @property {Vector} [flat] one colour for everything
 * @property {(joint: Joint) => Tint | null} [tintOf]
 */
/** @typedef {{ scale: number, hasFloor: boolean, hasGrid: boolean }} Drawing `scale`: device pixels for each pixel. */
/** @typedef {{ program: WebGLProgram, uniforms: Record<string, WebGLUniformLocation | null> }} Program */
/** @typedef {{ vertices: WebGLVertexArrayObject, count: number }} Loaded */

const ATTRIBUTES = ["position", "normal", "tone"];
const LEAST_SHADOW = 22; // millimetres: smaller parts throw none
const START_SIZE = 1024; // pixels

/** The hidden canvas and what is loaded to the graphics card. */
export class Renderer {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.canvas = /** @type {HTMLCanvasElement} */ (gl.canvas);
    this._gl = gl;
    this._body = compile(gl, BODY_VERTEX, BODY_FRAGMENT);
    this._floor = compile(gl, FLOOR_VERTEX, FLOOR_FRAGMENT);
    this._square = loadArrays(gl, [[[-1, 0, -1, 1, 0, -1, -1, 0, 1, 1, 0, 1], 3]]);
    /** @type {WeakMap<Figure, (Loaded | null)[]>} */
    this._figures = new WeakMap();
  }

  /** Return a renderer, or null where WebGL2 is missing. */
  static create() {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = START_SIZE;
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, preserveDrawingBuffer: true });
    return gl === null ? null : new Renderer(gl);
  }

  /** Whether the graphics card has dropped everything, as after a crash of its driver. */
  get isLost() {
    return this._gl.isContextLost();
  }

  /**
   * Draw a figure in the upper left corner of the canvas. Return width and height in device pixels.
   * @param {Figure} figure
   * @param {Camera} camera
   * @param {Layer[]} layers
   * @param {Drawing} drawing
   */
  draw(figure, camera, layers, drawing) {
    const gl = this._gl;
    const width = Math.round(camera.width * drawing.scale),
      height = Math.round(camera.height * drawing.scale);
    this._prepare(width, height);
    if (drawing.hasFloor) this._drawFloor(figure, camera, layers[0].matrices, drawing);
    this._beginBodies(camera);
    for (const layer of layers) {
      if (layer.alpha === undefined) this._drawLayer(figure, layer);
      else this._drawGhost(figure, layer);
    }
    gl.bindVertexArray(null);
    return { width, height };
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  _prepare(width, height) {
    const gl = this._gl,
      canvas = this.canvas;
    if (canvas.width < width) canvas.width = width;
    if (canvas.height < height) canvas.height = height;
    const bottom = canvas.height - height;
    gl.viewport(0, bottom, width, height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, bottom, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /**
   * @param {Figure} figure
   * @param {Camera} camera
   * @param {Matrix[]} matrices
   * @param {Drawing} drawing
   */
  _drawFloor(figure, camera, matrices, drawing) {
    const gl = this._gl,
      { program, uniforms } = this._floor,
      colours = palette();
    const found = shadows(figure, matrices),
      data = new Float32Array(4 * MOST_SHADOWS);
    data.set(found);
    gl.useProgram(program);
    gl.uniform4fv(uniforms.shadows, data);
    gl.uniform1i(uniforms.count, found.length / 4);
    gl.uniform3fv(uniforms.line, colours.line);
    gl.uniform1f(uniforms.shade, colours.isNight ? 0.55 : 0.2);
    gl.uniform1f(uniforms.grid, drawing.hasGrid ? 1 : 0);
    gl.uniform1f(uniforms.size, figure.data.view.floor ?? 420);
    gl.uniformMatrix4fv(uniforms.camera, false, camera.matrix);
    gl.depthMask(false);
    gl.bindVertexArray(this._square);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.depthMask(true);
  }

  /** @param {Camera} camera */
  _beginBodies(camera) {
    const gl = this._gl,
      { program, uniforms } = this._body,
      colours = palette();
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, camera.matrix);
    gl.uniform3fv(uniforms.eye, camera.eye);
    gl.uniform3fv(uniforms.glow, colours.glow);
    gl.uniform1f(uniforms.night, colours.isNight ? 1 : 0);
  }

  /**
   * Draw a translucent pose: the background shows through, the far side of the pose does not.
   * @param {Figure} figure
   * @param {Layer} layer
   */
  _drawGhost(figure, layer) {
    const gl = this._gl;
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 600);
    gl.colorMask(false, false, false, false); // first only its depth
    this._drawLayer(figure, layer);
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.LEQUAL);
    this._drawLayer(figure, layer);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /**
   * @param {Figure} figure
   * @param {Layer} layer
   */
  _drawLayer(figure, layer) {
    const gl = this._gl,
      { uniforms } = this._body,
      colours = palette(),
      loaded = this._loaded(figure);
    gl.uniform1f(uniforms.alpha, layer.alpha ?? 1);
    gl.uniform3fv(uniforms.shell, layer.flat ?? colours.shell);
    gl.uniform3fv(uniforms.dark, layer.flat ?? colours.dark);
    figure.joints.forEach((joint, index) => {
      const part = loaded[index];
      if (part === null) return;
      const tint = layer.tintOf?.(joint);
      gl.uniformMatrix4fv(uniforms.model, false, layer.matrices[index]);
      gl.uniform3fv(uniforms.limb, layer.flat ?? colours.groups[joint.group] ?? colours.shell);
      gl.uniform3fv(uniforms.tint, tint?.tint ?? colours.accent);
      gl.uniform1f(uniforms.amount, tint?.amount ?? 0);
      gl.bindVertexArray(part.vertices);
      gl.drawElements(gl.TRIANGLES, part.count, gl.UNSIGNED_INT, 0);
    });
  }

  /** @param {Figure} figure */
  _loaded(figure) {
    let loaded = this._figures.get(figure);
    if (loaded === undefined) {
      loaded = figure.joints.map((joint) => (joint.shapes.length > 0 ? load(this._gl, joint) : null));
      this._figures.set(figure, loaded);
    }
    return loaded;
  }
}

/**
 * Return x, height, z and radius of the shadow of each large part.
 * @param {Figure} figure
 * @param {Matrix[]} matrices
 */
function shadows(figure, matrices) {
  /** @type {number[]} */
  const found = [];
  figure.joints.forEach((joint, index) => {
    for (const shape of joint.shapes) {
      const size = "box" in shape ? Math.max(...shape.box) : shape.disc[0] * 2;
      if (size <= LEAST_SHADOW || found.length === 4 * MOST_SHADOWS) continue;
      const [x, y, z] = apply(matrices[index], shape.at ?? [0, 0, 0]);
      found.push(x - y * 0.12, y, z - y * 0.08, size * 0.62 + y * 0.1);
    }
  });
  return found;
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {Joint} joint
 * @returns {Loaded}
 */
function load(gl, joint) {
  const mesh = meshOf(joint.shapes);
  const vertices = loadArrays(gl, [
    [mesh.positions, 3],
    [mesh.normals, 3],
    [mesh.tones, 1],
  ]);
  gl.bindVertexArray(vertices);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(mesh.indexes), gl.STATIC_DRAW);
  gl.bindVertexArray(null);
  return { vertices, count: mesh.indexes.length };
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {[number[], number][]} arrays values, and how many of them belong to one point
 */
function loadArrays(gl, arrays) {
  const vertices = gl.createVertexArray();
  gl.bindVertexArray(vertices);
  arrays.forEach(([values, size], index) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, size, gl.FLOAT, false, 0, 0);
  });
  gl.bindVertexArray(null);
  return vertices;
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {string} vertexSource
 * @param {string} fragmentSource
 * @returns {Program}
 */
function compile(gl, vertexSource, fragmentSource) {
  const program = gl.createProgram();
  for (const [type, source] of /** @type {[number, string][]} */ ([
    [gl.VERTEX_SHADER, vertexSource],
    [gl.FRAGMENT_SHADER, fragmentSource],
  ])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  ATTRIBUTES.forEach((name, index) => gl.bindAttribLocation(program, index, name));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no program");
  return { program, uniforms: uniformsOf(gl, program) };
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLProgram} program
 */
function uniformsOf(gl, program) {
  /** @type {Program["uniforms"]} */
  const uniforms = {};
  for (let index = 0; index < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); index++) {
    const name = gl.getActiveUniform(program, index)?.name.replace("[0]", "") ?? "";
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return uniforms;
}
