// Tiles of linear light in the memory of the graphics card, fetched when they come into view.

import { look, named } from "./api.js";

export const TILE = 512; // pixels, a side
const KEPT = 160; // tiles of 2 MB
const AT_ONCE = 6; // requests

/** @typedef {import("./api.js").Source} Source */
/** `basis`: of what a picture hides, the plate that is matched to it, or the layer behind which the scene is guessed.
 * @typedef {{source: Source, part: string, frame: number, basis?: Source}} Part */
/** @typedef {{texture: WebGLTexture | null, used: number, stop: AbortController | null, failed: boolean}} Held */

/** Pixels of a side at a level. @param {number} side @param {number} level */
export function sideAt(side, level) {
  let now = side;
  for (let k = 0; k < level; k++) now = Math.ceil(now / 2);
  return now;
}

export class Tiles {
  /** @param {WebGL2RenderingContext} gl @param {() => void} changed  called when a tile has come */
  constructor(gl, changed) {
    this.gl = gl;
    this.changed = changed;
    this.held = /** @type {Map<string, Held>} */ (new Map());
    this.wanted = /** @type {{key: string, part: Part, level: number, x: number, y: number, size: number[]}[]} */ ([]);
    this.running = 0;
    this.turn = 0;
  }

  /** Begin to draw: what is not asked for until `end` is no longer fetched. */
  begin() {
    this.turn += 1;
    this.wanted = [];
  }

  end() {
    for (const [key, one] of this.held) {
      if (one.stop && one.used < this.turn - 1) {
        one.stop.abort();
        this.held.delete(key);
      }
    }
    this.forget();
    this.fetchMore();
  }

  /** Whether all tiles that were asked for are there. */
  get complete() {
    return this.running === 0 && this.wanted.length === 0;
  }

  /** The texture of a tile, or null; then it is fetched.
   * @param {Part} part @param {number} level @param {number} x @param {number} y
   * @param {number[]} size  of the whole picture at level 0 */
  get(part, level, x, y, size) {
    const key = `${named(part.source)}|${part.basis ? named(part.basis) : ""}|${part.part}|${part.frame}|${level}|${x}|${y}`;
    const one = this.held.get(key);
    if (one) {
      one.used = this.turn;
      return one.texture;
    }
    if (!this.wanted.some((other) => other.key === key)) {
      this.wanted.push({ key, part, level, x, y, size });
    }
    return null;
  }

  fetchMore() {
    while (this.running < AT_ONCE && this.wanted.length) {
      const next = this.wanted.shift();
      if (next && !this.held.has(next.key)) this.fetchOne(next);
    }
  }

  /** @param {{key: string, part: Part, level: number, x: number, y: number, size: number[]}} tile */
  async fetchOne(tile) {
    const { key, part, level, x, y, size } = tile;
    const one = /** @type {Held} */ ({ texture: null, used: this.turn, stop: new AbortController(), failed: false });
    this.held.set(key, one);
    this.running += 1;
    try {
      const basis = Object.entries(part.basis ?? {}).map(([name, value]) => [`basis_${name}`, value]);
      const values = { part: part.part, frame: part.frame, level, x, y, ...Object.fromEntries(basis) };
      const data = await (await look("tile", part.source, values, one.stop?.signal)).arrayBuffer();
      const [width, height] = size.map((side, k) =>
        Math.min(TILE, sideAt(side, level) - TILE * (k ? y : x)));
      one.texture = this.upload(new Uint16Array(data), width, height);
    } catch (error) {
      if (/** @type {Error} */ (error).name === "AbortError") this.held.delete(key);
      else one.failed = true;
    } finally {
      one.stop = null;
      this.running -= 1;
      this.changed();
    }
  }

  /** @param {Uint16Array} data @param {number} width @param {number} height */
  upload(data, width, height) {
    const gl = this.gl;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, data);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    return texture;
  }

  /** Drop the tiles that were not used for longest. */
  forget() {
    if (this.held.size <= KEPT) return;
    const oldest = [...this.held].filter(([, one]) => one.texture && one.used < this.turn)
      .sort((a, b) => a[1].used - b[1].used);
    for (const [key, one] of oldest.slice(0, this.held.size - KEPT)) {
      this.gl.deleteTexture(one.texture);
      this.held.delete(key);
    }
  }
}
