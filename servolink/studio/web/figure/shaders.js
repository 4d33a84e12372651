// The programs of the graphics card: bodies with soft light, and the floor with grid and shadows.

/** Vertex shader of the shapes of a robot. */
export const BODY_VERTEX = `#version 300 es
in vec3 position; in vec3 normal; in float tone;
uniform mat4 model, camera;
out vec3 outward; out vec3 place; flat out int kind;
void main() {
  vec4 p = model * vec4(position, 1.);
  place = p.xyz;
  outward = mat3(model) * normal;
  kind = int(tone + .5);
  gl_Position = camera * p;
}`;

/** Fragment shader of the shapes: light from the side, and shadows. */
export const BODY_FRAGMENT = `#version 300 es
precision highp float;
in vec3 outward; in vec3 place; flat in int kind;
uniform vec3 shell, limb, dark, glow, eye, tint;
uniform float alpha, amount, night;
out vec4 colour;
void main() {
  vec3 base = kind == 0 ? shell : kind == 1 ? limb : kind == 2 ? dark : glow;
  if (kind == 3) { colour = vec4(base * alpha, alpha); return; }
  base = mix(base, tint, amount);
  vec3 n = normalize(outward), view = normalize(eye - place);
  vec3 key = normalize(vec3(.35, .9, .55)), fill = normalize(vec3(-.7, .25, .5));
  float bright = clamp(dot(n, key) * .62 + .38, 0., 1.), soft = clamp(dot(n, fill) * .5 + .5, 0., 1.);
  vec3 c = base * (.30 + .52 * bright * bright + .18 * soft + .12 * (n.y * .5 + .5));
  float shine = pow(max(dot(n, normalize(key + view)), 0.), kind == 2 ? 40. : 24.);
  c += shine * (kind == 2 ? .28 : .13);
  c += pow(1. - max(dot(n, view), 0.), 3.) * mix(.10, .20, night) * vec3(.85, .9, 1.);
  colour = vec4(c * alpha, alpha);
}`;

/** Most shadows of shapes on the floor in one drawing. */
export const MOST_SHADOWS = 24;

/** Vertex shader of the floor below the robot. */
export const FLOOR_VERTEX = `#version 300 es
in vec3 position;
uniform mat4 camera; uniform float size;
out vec2 place;
void main() {
  place = position.xz * size;
  gl_Position = camera * vec4(place.x, -.3, place.y, 1.);
}`;

/** Fragment shader of the floor, with grid and shadows. */
export const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform vec4 shadows[${MOST_SHADOWS}]; uniform int count;
uniform vec3 line; uniform float shade, grid, size;
out vec4 colour;
float lines(float step) {
  vec2 q = abs(fract(place / step - .5) - .5) / fwidth(place / step);
  return 1. - min(min(q.x, q.y), 1.);
}
void main() {
  float fade = smoothstep(1., .15, length(place) / size), dark = 0.;
  for (int i = 0; i < ${MOST_SHADOWS}; i++) {
    if (i >= count) break;
    vec2 away = place - shadows[i].xz;
    float radius = shadows[i].w;
    dark = max(dark, exp(-dot(away, away) / (radius * radius)) * clamp(1. - shadows[i].y / 420., .12, 1.));
  }
  float drawn = max(lines(25.) * .35, lines(100.)) * fade * grid * .5, shadow = dark * shade * fade;
  colour = vec4(line * drawn * (1. - shadow), drawn * (1. - shadow) + shadow);
}`;
