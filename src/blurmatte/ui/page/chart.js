// One chart of a motion over the frames of a clip: a mark and an error bar for each point, a curve for a fall.

/** A quantity by its name in a row; of a place with its axis, and the parabolas through it. `off`: how far it is off them.
 * @typedef {{name: string, title: string, down: boolean, axis: string, falls: any[], off: boolean}} Chart */
/** @typedef {{number: number, alone: boolean, color: string, mark: string}} Drawn */
/** @typedef {{frame: number, value: number, std: number, hollow: boolean}} Point */

/** Each mark as a path around 0, 5 units far. */
export const MARK_PATHS = /** @type {Record<string, string>} */ ({
  circle: "M5 0A5 5 0 1 1 -5 0A5 5 0 1 1 5 0Z", square: "M-4.5 -4.5H4.5V4.5H-4.5Z", triangle: "M0 -5.5L5.5 4.5H-5.5Z",
  diamond: "M0 -6L6 0L0 6L-6 0Z", cross: "M-5 -2H-2V-5H2V-2H5V2H2V5H-2V2H-5Z",
});

const HEIGHT = 130; // pixels
const CURVE_STEPS = 80;

let loading = /** @type {Promise<void> | null} */ (null);

/** Load the charts' library when the first one is drawn. */
export function library() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/page/vendor/uplot.js";
    script.onload = () => resolve();
    script.onerror = reject;
    document.head.append(script);
  });
  return loading;
}

/** The place of the parabola at a time. @param {any} fall @param {string} axis @param {number} time */
function parabola(fall, axis, time) {
  const t = time - fall.time;
  return fall[`place_${axis}`] + fall[`velocity_${axis}`] * t + (fall[`acceleration_${axis}`] * t * t) / 2;
}

/** Points of an object in a chart; hollow are those in doubt, or without weight in the parabola.
 * @param {any[]} all @param {Drawn} object @param {Chart} what @returns {Point[]} */
function pointsOf(all, object, { name, axis, falls, off }) {
  const fall = falls.find((one) => one.object === object.number);
  const points = all.filter((row) => (row.object ?? 1) === object.number && row[name] != null && (!off || (fall && row.time != null)));
  return points.map((row) => ({
    frame: row.frame, value: row[name] - (off ? parabola(fall, axis, row.time) : 0), std: row[`${name}_std`] ?? 0,
    hollow: Boolean(row.doubts) || Boolean(off && fall.off.includes(row.frame)),
  }));
}

/** @param {Element} place @param {number} width @param {any[]} all @param {Drawn[]} objects @param {Chart} what
 * @param {{go: (frame: number) => void, point: (frame: number | null) => void}} how */
export function chart(place, width, all, objects, what, how) {
  const frames = [...new Set(all.map((row) => row.frame))].sort((a, b) => a - b);
  const style = getComputedStyle(document.body);
  const axis = { space: 24, stroke: style.color, grid: { stroke: "#8884" }, ticks: { stroke: "#8884" } };
  const drawn = objects.map((object) => ({ object, points: pointsOf(all, object, what) }));
  const edge = (/** @type {Point[]} */ points, /** @type {number} */ sign) => {
    const by = new Map(points.map((one) => [one.frame, one.value + (one.hollow ? 0 : sign * one.std)]));
    return frames.map((frame) => by.get(frame) ?? null);
  };
  const series = drawn.flatMap(({ points }) => [edge(points, -1), edge(points, 1)]); // for its scale alone
  const made = new (/** @type {any} */ (window).uPlot)({
    width, height: HEIGHT, title: what.title,
    scales: { x: { time: false }, y: { dir: what.down ? -1 : 1 } }, legend: { show: false },
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    series: [{}, ...series.map(() => ({ stroke: "#0000", points: { show: false } }))],
    axes: [{ ...axis, space: 40 }, axis],
    hooks: {
      draw: [(/** @type {any} */ plot) => {
        plot.ctx.save();
        plot.ctx.beginPath();
        plot.ctx.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
        plot.ctx.clip();
        if (what.off) line(plot, [[frames[0], 0], [frames[frames.length - 1], 0]], style.color, [6, 4]);
        else curves(plot, all, what, style.color);
        for (const { object, points } of drawn) {
          marks(plot, points, object, object.alone ? style.color : resolved(place, object.color));
        }
        plot.ctx.restore();
      }],
      ready: [(/** @type {any} */ plot) => {
        const nearest = () => frames[plot.cursor.idx ?? 0];
        plot.over.addEventListener("click", () => how.go(nearest()));
        plot.over.addEventListener("mousemove", () => how.point(nearest()));
        plot.over.addEventListener("mouseleave", () => how.point(null));
      }],
    },
  }, [frames, ...series], place);
  made.root.setAttribute("role", "img");
  made.root.setAttribute("aria-label", inWords(what.title, drawn));
  return made;
}

/** A color of the style sheet as a canvas takes it. @param {Element} place @param {string} name */
function resolved(place, name) {
  const probe = place.appendChild(document.createElement("i"));
  probe.style.color = `var(${name})`;
  const color = getComputedStyle(probe).color;
  probe.remove();
  return color;
}

/** @param {string} title @param {{object: Drawn, points: Point[]}[]} drawn */
function inWords(title, drawn) {
  const each = drawn.filter(({ points }) => points.length).map(({ object, points }) => {
    const values = points.map((one) => one.value);
    return `${object.alone ? "" : `object ${object.number} `}from ${Math.min(...values).toPrecision(4)} to ${Math.max(...values).toPrecision(4)} in ${points.length} frames`;
  });
  return `chart over frames, ${title}: ${each.join("; ")}`;
}

/** The parabolas of falls, dashed, over the frames of their objects.
 * @param {any} plot @param {any[]} all @param {Chart} what @param {string} color */
function curves(plot, all, what, color) {
  for (const fall of what.falls) {
    const timed = all.filter((row) => (row.object ?? 1) === fall.object && row[what.name] != null && row.time != null);
    if (fall.rejection || timed.length < 2) continue;
    const [first, last] = [timed[0], timed[timed.length - 1]];
    const points = Array.from({ length: CURVE_STEPS + 1 }, (_, k) => {
      const share = k / CURVE_STEPS;
      return [first.frame + share * (last.frame - first.frame), parabola(fall, what.axis, first.time + share * (last.time - first.time))];
    });
    line(plot, points, color, [6, 4]);
  }
}

/** @param {any} plot @param {number[][]} points @param {string} color @param {number[]} dashes */
function line(plot, points, color, dashes) {
  const pen = plot.ctx;
  pen.beginPath();
  points.forEach(([x, y]) => pen.lineTo(plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)));
  Object.assign(pen, { strokeStyle: color, lineWidth: devicePixelRatio });
  pen.setLineDash(dashes.map((dash) => dash * devicePixelRatio));
  pen.stroke();
  pen.setLineDash([]);
}

/** @param {any} plot @param {Point[]} points @param {Drawn} object @param {string} color */
function marks(plot, points, object, color) {
  const pen = plot.ctx;
  const mark = new Path2D(MARK_PATHS[object.mark]);
  const size = 0.6 * devicePixelRatio;
  Object.assign(pen, { strokeStyle: color, fillStyle: color });
  for (const { frame, value, std, hollow } of points) {
    const x = plot.valToPos(frame, "x", true);
    line(plot, [[frame, value - std], [frame, value + std]], color, []);
    pen.save();
    pen.translate(x, plot.valToPos(value, "y", true));
    pen.scale(size, size);
    pen.lineWidth = 2;
    if (hollow) pen.stroke(mark);
    else pen.fill(mark);
    pen.restore();
  }
}
