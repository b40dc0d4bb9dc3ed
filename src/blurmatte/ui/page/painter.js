// Draws pictures and layers in linear light, with changes of the object, as the commands compute them.

import { TILE, Tiles, sideAt } from "./tiles.js";

/** @typedef {import("./tiles.js").Part} Part */

/** What a pixel shows. */
export const MODES = ["picture", "plate", "alpha", "color", "error", "flags", "checker", "result", "layer"];

/** A change of an object: `share` of its alpha at most 1, a matrix of its light (by columns).
 * @typedef {{fade: number, light: number[]}} Change */

/** Something to draw: parts by name, moved and scaled, over what is there already or in its place.
 * @typedef {{mode: string, size: number[], parts: Record<string, Part | null>, change: Change,
 *   scale: number, at: number[], over: boolean}} Item */

/** A strip of the canvas, from and to in fractions of its width.
 * @typedef {{from: number, to: number, items: Item[], stops: number, falseColor: boolean, data: boolean}} Strip */

const CORNERS = `#version 300 es
in vec2 corner;
uniform vec4 place;  // x, y, width, height on the canvas, 0 to 1 from the upper left
out vec2 inside;
void main() {
  inside = corner;
  vec2 at = place.xy + corner * place.zw;
  gl_Position = vec4(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0);
}`;

const LIGHT = `#version 300 es
precision highp float;
in vec2 inside;
out vec4 light;
uniform sampler2D picture, plate, layer, error;
uniform vec4 pictureBox, plateBox, layerBox, errorBox;  // of this tile in each texture
uniform vec4 pixels;  // of this tile in the whole picture
uniform int mode;
uniform float fade, white;
uniform mat3 relit;
float decoded(float code) { return code <= 0.04045 ? code / 12.92 : pow((code + 0.055) / 1.055, 2.4); }
vec4 of(sampler2D texture_, vec4 box) { return texture(texture_, box.xy + inside * box.zw); }
vec3 heat(float x) {
  x = clamp(x, 0.0, 1.0);
  return vec3(smoothstep(0.25, 0.7, x), smoothstep(0.5, 1.0, x), smoothstep(0.0, 0.3, x) - smoothstep(0.3, 0.65, x) + smoothstep(0.8, 1.0, x));
}
void main() {
  vec3 seen = of(picture, pictureBox).rgb;
  vec3 behind = of(plate, plateBox).rgb;
  vec4 object = of(layer, layerBox);
  float changed = min(fade * object.a, max(object.a, 1.0));
  float share = object.a > 0.0 ? changed / object.a : fade;
  vec3 lit = share * (relit * object.rgb);
  light = vec4(seen, 1.0);
  if (mode == 1) light.rgb = behind;
  else if (mode == 2) light.rgb = vec3(decoded(clamp(object.a / white, 0.0, 1.0)));
  else if (mode == 3) light.rgb = object.a > 0.02 * white ? object.rgb / object.a : vec3(0.0);
  else if (mode == 4) { vec3 code = heat(of(error, errorBox).r / 0.1); light.rgb = vec3(decoded(code.r), decoded(code.g), decoded(code.b)); }
  else if (mode == 5) {
    int bits = int(of(error, errorBox).g + 0.5);
    bool outside = (bits & 16) != 0;
    vec3 dim = 0.35 * seen;
    light.rgb = outside ? dim : bits == 0 ? mix(dim, vec3(0.02, 0.35, 0.08), 0.5)
      : (bits & 8) != 0 ? vec3(0.8, 0.05, 0.05) : (bits & 1) != 0 ? vec3(0.9, 0.8, 0.05)
      : (bits & 32) != 0 ? vec3(0.1, 0.1, 0.7) : (bits & 64) != 0 ? vec3(0.5, 0.05, 0.6) : vec3(0.9, 0.35, 0.02);
  }
  else if (mode == 6) {
    vec2 at = floor((pixels.xy + inside * pixels.zw) / 12.0);
    float ground = mod(at.x + at.y, 2.0) < 1.0 ? 0.42 : 0.18;
    light.rgb = lit + (1.0 - changed) * ground;
  }
  else if (mode == 7) light.rgb = seen + (lit - object.rgb) + (object.a - changed) * behind;
  else if (mode == 8) light = vec4(lit, changed);
}`;

const SHOWN = `#version 300 es
precision highp float;
in vec2 inside;
out vec4 code;
uniform sampler2D light;
uniform float gain;
uniform bool falseColor;
float coded(float x) { return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055; }
void main() {
  vec4 all = texture(light, vec2(inside.x, 1.0 - inside.y));
  vec3 seen = gain * all.rgb;
  if (falseColor) {
    float stops = log2(max(dot(seen, vec3(0.2126, 0.7152, 0.0722)), 1e-5) / 0.18);
    seen = stops > 2.45 ? vec3(1.0, 0.02, 0.02) : stops > 1.5 ? vec3(0.9, 0.7, 0.05) : stops < -6.0 ? vec3(0.15, 0.0, 0.35)
      : stops < -4.0 ? vec3(0.02, 0.05, 0.5) : abs(stops) < 0.25 ? vec3(0.05, 0.45, 0.08) : vec3(dot(seen, vec3(0.2126, 0.7152, 0.0722)));
  }
  seen = clamp(seen, 0.0, 1.0);
  code = vec4(coded(seen.r), coded(seen.g), coded(seen.b), 1.0) * min(all.a, 1.0);
}`;

export class Painter {
  /** @param {HTMLCanvasElement} canvas @param {() => void} changed
   * @throws {Error} without WebGL2 and half floats to draw into */
  constructor(canvas, changed) {
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: false, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("no WebGL2");
    this.gl = gl;
    this.canvas = canvas;
    this.tiles = new Tiles(gl, changed);
    this.lights = program(gl, LIGHT);
    this.shows = program(gl, SHOWN);
    const corners = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, corners);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.black = this.tiles.upload(new Uint16Array(4), 1, 1);
    this.target = gl.createTexture();
    this.frame = gl.createFramebuffer();
    this.targetSize = [0, 0];
  }

  /** Draw strips; true when nothing is missing.
   * @param {Strip[]} strips @param {{x: number, y: number, zoom: number}} view  x, y of the picture at the
   *   upper left of the canvas, and pixels of the canvas for one of the picture
   * @param {number} white  alpha that is shown white */
  draw(strips, view, white) {
    const gl = this.gl;
    const { width, height } = this.canvas;
    this.sizeTarget(width, height);
    this.tiles.begin();
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    for (const strip of strips) {
      const from = Math.round(strip.from * width);
      gl.scissor(from, 0, Math.max(Math.round(strip.to * width) - from, 0), height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.useProgram(this.lights.program);
      for (const item of strip.items) this.drawItem(item, view, white);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      gl.disable(gl.BLEND);
      gl.useProgram(this.shows.program);
      this.bind(this.shows, "light", 0, this.target);
      gl.uniform1f(this.shows.at("gain"), strip.data ? 1 : 2 ** strip.stops);
      gl.uniform1i(this.shows.at("falseColor"), strip.falseColor && !strip.data ? 1 : 0);
      gl.uniform4f(this.shows.at("place"), 0, 0, 1, 1);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    gl.disable(gl.SCISSOR_TEST);
    this.tiles.end();
    return this.tiles.complete;
  }

  /** @param {Item} item @param {{x: number, y: number, zoom: number}} view @param {number} white */
  drawItem(item, view, white) {
    const gl = this.gl;
    const zoom = view.zoom * item.scale;
    const top = topLevel(item.size);
    const level = Math.max(0, Math.min(top, Math.floor(-Math.log2(zoom) + 0.01)));
    const x0 = (view.x - item.at[0]) / item.scale;
    const y0 = (view.y - item.at[1]) / item.scale;
    const step = TILE * 2 ** level;
    const last = item.size.map((side, k) => Math.min(
      Math.ceil(sideAt(side, level) / TILE) - 1,
      Math.floor((k ? y0 + this.canvas.height / zoom : x0 + this.canvas.width / zoom) / step)));
    if (item.over) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    } else gl.disable(gl.BLEND);
    gl.uniform1f(this.lights.at("fade"), item.change.fade);
    gl.uniform1f(this.lights.at("white"), white);
    gl.uniformMatrix3fv(this.lights.at("relit"), false, item.change.light);
    for (let y = Math.max(0, Math.floor(y0 / step)); y <= last[1]; y++) {
      for (let x = Math.max(0, Math.floor(x0 / step)); x <= last[0]; x++) {
        this.drawTile(item, level, top, x, y, [x0, y0, zoom]);
      }
    }
  }

  /** @param {Item} item @param {number} level @param {number} top @param {number} x @param {number} y
   * @param {number[]} origin */
  drawTile(item, level, top, x, y, [x0, y0, zoom]) {
    const gl = this.gl;
    const scale = 2 ** level;
    const [width, height] = item.size.map((side, k) =>
      Math.min(TILE * scale, side - TILE * scale * (k ? y : x)));
    const left = TILE * scale * x;
    const above = TILE * scale * y;
    let missing = false;
    ["picture", "plate", "layer", "error"].forEach((name, unit) => {
      const part = needs(item.mode, name) || name === "picture" ? item.parts[name] : null;
      const found = part ? this.texture(part, level, top, x, y, item.size) : null;
      if (part && !found && needs(item.mode, name)) missing = true;
      this.bind(this.lights, name, unit, found ? found.texture : this.black, zoom >= 2);
      if (!found) return gl.uniform4f(this.lights.at(`${name}Box`), 0, 0, 1, 1);
      const k = 2 ** found.level; // the tile's place in the texture, which may be a coarser one
      const tile = [found.x, found.y].map((at) => at * TILE * k);
      const whole = item.size.map((side, axis) => k * Math.min(TILE, sideAt(side, found.level) - tile[axis] / k));
      return gl.uniform4f(this.lights.at(`${name}Box`), (left - tile[0]) / whole[0], (above - tile[1]) / whole[1],
        width / whole[0], height / whole[1]);
    });
    if (missing && !item.parts.picture) return; // else the picture is seen until all of it has come
    gl.uniform1i(this.lights.at("mode"), MODES.indexOf(missing ? "picture" : item.mode));
    gl.uniform4f(this.lights.at("pixels"), left, above, width, height);
    gl.uniform4f(this.lights.at("place"), (left - x0) * zoom / this.canvas.width,
      (above - y0) * zoom / this.canvas.height, width * zoom / this.canvas.width, height * zoom / this.canvas.height);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /** A tile, or the part of a coarser one in its place while it comes.
   * @param {Part} part @param {number} level @param {number} top @param {number} x @param {number} y
   * @param {number[]} size */
  texture(part, level, top, x, y, size) {
    let found = null;
    for (let k = top; k >= level; k--) { // the coarsest comes first, so that something is seen soon
      const [i, j] = [x, y].map((at) => at >> (k - level));
      if (k !== level && k !== top) continue;
      const texture = this.tiles.get(part, k, i, j, size);
      if (texture) found = { texture, level: k, x: i, y: j };
    }
    return found;
  }

  /** @param {{at: (name: string) => WebGLUniformLocation | null}} shader @param {string} name
   * @param {number} unit @param {WebGLTexture | null} texture @param {boolean} [sharp] */
  bind(shader, name, unit, texture, sharp = false) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, sharp ? gl.NEAREST : gl.LINEAR);
    gl.uniform1i(shader.at(name), unit);
  }

  /** @param {number} width @param {number} height */
  sizeTarget(width, height) {
    const gl = this.gl;
    if (this.targetSize[0] === width && this.targetSize[1] === height) return;
    this.targetSize = [width, height];
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.target);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, null);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.target, 0);
  }
}

/** The level at which a picture is a single tile. @param {number[]} size */
export function topLevel(size) {
  let level = 0;
  while (Math.max(sideAt(size[0], level), sideAt(size[1], level)) > TILE) level += 1;
  return level;
}

/** Whether a mode shows nothing right without a part. @param {string} mode @param {string} name */
const needs = (mode, name) => ({
  picture: ["picture"], plate: ["plate"], alpha: ["layer"], color: ["layer"], error: ["error"],
  flags: ["picture", "error"], checker: ["layer"], result: ["picture", "plate", "layer"], layer: ["layer"],
})[mode]?.includes(name);

/** @param {WebGL2RenderingContext} gl @param {string} fragment */
function program(gl, fragment) {
  const made = gl.createProgram();
  for (const [kind, text] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, CORNERS], [gl.FRAGMENT_SHADER, fragment]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
    gl.attachShader(made, shader);
  }
  gl.bindAttribLocation(made, 0, "corner");
  gl.linkProgram(made);
  const places = /** @type {Map<string, WebGLUniformLocation | null>} */ (new Map());
  const at = (/** @type {string} */ name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(made, name));
    return places.get(name) ?? null;
  };
  return { program: made, at };
}

/** The change of light of an object, by columns: fade, amplify, recolor, expose, gain, in this order.
 * @param {import("./words.js").Changes} changes
 * @param {number[][]} paints  linear light of the object's paints
 * @param {number[][]} colors  of the new ones
 * @param {number} brightest  of the object's color, its 99 % quantile
 * @returns {Change} */
export function changeOf(changes, paints, colors, brightest) {
  const bright = changes.amplify === 1 || brightest <= 0 ? 1 : 1 / brightest;
  let light = [[bright, 0, 0], [0, bright, 0], [0, 0, bright]];
  if (colors.length) {
    const scaled = paints.map((row) => row.map((value) => value * bright));
    const painted = times(transposed(colors), times(inverse(scaled), light));
    if (painted.flat().every(Number.isFinite)) light = painted; // of paints of one hue the command says why not
  }
  const gain = changes.gain.map((value) => value * 2 ** changes.expose);
  light = light.map((row, k) => row.map((value) => value * gain[k]));
  return { fade: changes.fade * changes.amplify, light: transposed(light).flat() };
}

/** @param {number[][]} a @param {number[][]} b */
const times = (a, b) => a.map((row) => b[0].map((_, j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));

/** @param {number[][]} a */
const transposed = (a) => a[0].map((_, j) => a.map((row) => row[j]));

/** The matrix that splits light into paints by least squares. @param {number[][]} paints  (n, 3)
 * @returns {number[][]} (n, 3) */
function inverse(paints) {
  const gram = times(paints, transposed(paints));
  const n = gram.length;
  const rows = gram.map((row, i) => [...row, ...paints[i]]);
  for (let i = 0; i < n; i++) {
    const pivot = rows.slice(i).reduce((best, row, k) => Math.abs(row[i]) > Math.abs(rows[best][i]) ? i + k : best, i);
    [rows[i], rows[pivot]] = [rows[pivot], rows[i]];
    rows[i] = rows[i].map((value) => value / rows[i][i]);
    rows.forEach((row, k) => { if (k !== i) rows[k] = row.map((value, j) => value - row[i] * rows[i][j]); });
  }
  return rows.map((row) => row.slice(n));
}

/** Linear light of a hex color. @param {string} hex */
export const lightOf = (hex) => [1, 3, 5].map((k) => {
  const code = parseInt(hex.slice(k, k + 2), 16) / 255;
  return code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4;
});
