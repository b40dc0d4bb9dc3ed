// Command lines, from what was chosen on the page.

/** @typedef {import("./api.js").Source} Source */
/** @typedef {import("./api.js").Words} Words */

/** A plate: a source, or "none" if it is to be guessed.
 * @typedef {Source | "none"} Plate */

/** An option and its value, if there is one.
 * @param {string} name
 * @param {any} value
 * @returns {Words} */
function option(name, value) {
  return value === undefined || value === null || value === "" ? [] : [name, value];
}

/** @param {number[] | null} box */
export const boxWord = (box) => (box ? box.map(Math.round).join(",") : null);

/** Where something moved.
 * @param {Source} picture
 * @param {Plate} plate
 * @returns {Words} */
export const find = (picture, plate) => ["find", picture, "--plate", plate, "--json"];

/** @param {{picture: Source, plate: Plate | null, region: number[] | Source | null, colors: string[],
 *   colorFrom: Source | null, occluder: Source | null, rank: string, maxBrightness: string,
 *   seconds: string, opacity: string, frames: string, layers: string, several: boolean, clip: boolean}} chosen
 * @returns {Words} */
export function solve(chosen) {
  const region = Array.isArray(chosen.region) ? boxWord(chosen.region) : chosen.region;
  return [
    "solve", chosen.picture,
    ...option("--plate", chosen.plate),
    ...option("--region", chosen.clip ? null : region),
    ...option("--occluder", chosen.occluder),
    ...chosen.colors.flatMap((color) => ["--color", color]),
    ...option("--color-from", chosen.colorFrom),
    ...option("--rank", chosen.rank),
    ...option("--max-brightness", chosen.maxBrightness),
    ...option("--seconds", chosen.seconds),
    ...option("--opacity", chosen.opacity),
    ...(chosen.clip ? option("--frames", chosen.frames) : []),
    ...(chosen.clip ? option("--layers", chosen.layers) : []),
    ...(chosen.clip && chosen.several ? ["--several"] : []),
    "-o", { out: "" }, "--json",
  ];
}

/** A plate from a clip or several pictures.
 * @param {Source[]} pictures
 * @returns {Words} */
export const plate = (pictures) => ["plate", ...pictures, "-o", { out: "plate.exr" }, "--json"];

/** `paints`: colors of the object beyond those that were found; `recolor`: a new color of each paint, or "".
 * @typedef {{fade: number, amplify: number, paints: string[], recolor: string[], expose: number, gain: number[]}} Changes */

/** The changes in the order in which they are made; numbers as the program reads them.
 * @param {Changes} changes
 * @param {string[]} colors  of the object's paints
 * @returns {Words} */
export function changeWords(changes, colors) {
  const words = /** @type {Words} */ ([]);
  if (changes.fade !== 1) words.push("--fade", short(changes.fade));
  if (changes.amplify !== 1) words.push("--amplify", short(changes.amplify));
  const recolored = changes.recolor.filter(Boolean);
  if (recolored.length && colors.length > 1) {
    const pairs = colors.map((old, k) => `${old}=${changes.recolor[k] || old}`);
    words.push("--recolor", pairs.join(","));
  } else if (recolored.length) words.push("--recolor", recolored[0]);
  if (changes.expose !== 0) words.push("--expose", short(changes.expose));
  if (changes.gain.some((g) => g !== 1)) words.push("--gain", changes.gain.map(short).join(","));
  return words;
}

/** @param {number} value */
export const short = (value) => String(Number(value.toFixed(4)));

/** @param {Source} layer @param {Source} picture @param {Plate} plate @param {Words} changes
 * @param {string} name @returns {Words} */
export const edit = (layer, picture, plate, changes, name) =>
  ["edit", layer, "--image", picture, "--plate", plate, ...changes, "-o", { out: name }];

/** @param {Source} layer @param {Source} picture @param {Plate} plate @param {number} grow
 * @param {string} name @returns {Words} */
export const remove = (layer, picture, plate, grow, name) =>
  ["remove", layer, "--image", picture, "--plate", plate, ...(grow ? ["--grow", String(grow)] : []),
    "-o", { out: name }];

/** How long each paint was where. @param {Source} layer @param {string[]} colors @returns {Words} */
export const paints = (layer, colors) =>
  ["paints", layer, ...colors.flatMap((color) => ["--color", color]), "-o", { out: "" }, "--json"];

/** @param {Source} layer @param {Source} over @param {Words} changes
 * @param {{x: number, y: number, scale: number}} place @param {string} name @returns {Words} */
export const compose = (layer, over, changes, place, name) =>
  ["compose", layer, "--over", over, "--place", `${Math.round(place.x)},${Math.round(place.y)}`,
    ...(place.scale === 1 ? [] : ["--scale", short(place.scale)]), ...changes, "-o", { out: name }];

/** @typedef {{diameter: string, scale: string, exposure: string, lineTime: string, readout: string,
 *   plane: string[], camera: Source | null, gravity: string}} Ruler */

/** @param {Source} layer @param {Ruler} ruler @param {boolean} rotation @returns {Words} */
export const measure = (layer, ruler, rotation) =>
  ["measure", layer, ...rotation ? ["--rotation"] : [], ...scales(ruler),
    ...option("--line-time", ruler.lineTime), ...option("--readout", ruler.readout),
    "-o", { out: "motion.json" }, "--json"];

/** @param {Source} layer @param {Ruler} ruler @returns {Words} */
export const locate = (layer, ruler) =>
  ["locate", layer, ...option("--camera", ruler.camera), ...option("--diameter", ruler.diameter),
    ...option("--exposure", ruler.exposure), ...ruler.plane.flatMap((one) => ["--on-plane", one]),
    "--json"];

/** @param {Ruler} ruler @returns {Words} */
const scales = (ruler) => [
  ...option("--diameter", ruler.diameter),
  ...option("--scale", ruler.diameter ? null : ruler.scale),
  ...option("--exposure", ruler.exposure),
];

/** @param {Source} layer @param {Source | null} picture @param {Plate | null} plate
 * @param {{moments: number, spin: boolean}} how @returns {Words} */
export const sharpen = (layer, picture, plate, how) =>
  ["sharpen", layer, ...(picture && plate ? ["--image", picture, "--plate", plate] : []),
    ...(how.spin ? ["--spin", "auto"] : []), "--frames", String(how.moments),
    "--sheet", { out: "sharp.png" }, "-o", { out: "sharp.####.exr" }, "--json"];

/** @param {Source} clip @param {Plate | null} plate @param {Ruler} ruler
 * @param {{color: string, frames: string, several: boolean}} how @returns {Words} */
export const track = (clip, plate, ruler, how) =>
  ["track", clip, ...option("--plate", plate), ...option("--color", how.color),
    ...option("--frames", how.frames), ...(how.several ? ["--several"] : []), ...scales(ruler),
    ...option("--line-time", ruler.lineTime), ...option("--camera", ruler.camera),
    ...option("--gravity", ruler.gravity),
    "-o", { out: "track.csv" }, "--overlay", { out: "track.png" }, "--json"];

/** The shots of a clip. @param {Source} clip @returns {Words} */
export const shots = (clip) => ["info", clip, "--shots", "--json"];

/** A value and its error, with two digits of the error. @param {number} value @param {number | null} [std] */
export function withError(value, std) {
  if (!std) return String(Number(value.toPrecision(4)));
  const digits = Math.min(Math.max(0, 1 - Math.floor(Math.log10(std))), 6);
  return `${value.toFixed(digits)} ± ${std.toFixed(digits)}`;
}

/** The acceleration of a fall, and what follows from it. @param {any} fall */
export function fallInWords(fall) {
  const metric = fall.acceleration_in_m_per_s2 !== undefined;
  const size = metric ? withError(fall.acceleration_in_m_per_s2, fall.acceleration_in_m_per_s2_std) : withError(fall.acceleration, fall.acceleration_std);
  const unit = metric ? "m/s²" : "place_z" in fall ? "m/s²" : "pixels/s²";
  const off = fall.off.length ? ` Without weight: frames ${fall.off.join(", ")}.` : "";
  if (fall.rejection) return `No free fall: ${fall.rejection}.${off}`;
  const g = metric && fall.gravity === undefined ? `g = ${size} ${unit}` : `acceleration ${size} ${unit}`;
  const scale = fall.meters_per_pixel === undefined ? "" : ` By gravity a pixel is ${withError(1000 * fall.meters_per_pixel, 1000 * fall.meters_per_pixel_std)} mm.`;
  return `Free fall (dashed): ${g}.${scale}${off}`;
}

/** A line as a shell takes it. @param {string[]} words */
export const quoted = (words) => words.map((word) =>
  /^[\w@%+=:,./#-]+$/.test(word) && !word.startsWith("#") ? word : `'${word.replaceAll("'", "'\\''")}'`).join(" ");
