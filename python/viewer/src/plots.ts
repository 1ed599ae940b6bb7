// Draws the plots of the head as SVG.
import { make, makeSvg } from "./dom";

const HEIGHT = 176;
const LEFT = 42;
const RIGHT = 24;
const TOP = 10;
const BOTTOM = 22; // without the label of the axis
const LABEL = 15;

export interface Axis {
  label: string;
  min: number;
  max: number;
  isLogarithmic: boolean;
  ticks: { value: number; text: string }[];
}

export interface Curve {
  label: string;
  x: number[];
  y: number[];
  style: "solid" | "dashed";
}

type Scale = (value: number) => number;

function scaleOf(axis: Axis, from: number, to: number): Scale {
  const place = axis.isLogarithmic ? Math.log10 : (value: number) => value;
  const [low, high] = [place(axis.min), place(axis.max)];
  return (value) => from + ((place(value) - low) / (high - low || 1)) * (to - from);
}

// Returns 0 %, 25 % ... 100 %.
export function percentAxis(label: string, max = 1): Axis {
  const step = max > 0.5 ? 0.25 : max > 0.2 ? 0.1 : max > 0.1 ? 0.05 : 0.02;
  const ticks = [];
  for (let value = 0; value <= max + 1e-9; value += step) ticks.push({ value, text: `${Math.round(100 * value)}` });
  return { label, min: 0, max, isLogarithmic: false, ticks };
}

// Returns an axis over whole decades, or over 1-2-5 steps if the values span less than two decades.
export function logAxis(label: string, values: number[], text: (value: number) => string): Axis {
  const low = Math.log10(Math.min(...values));
  const high = Math.log10(Math.max(...values));
  const steps = high - low < 2 ? [1, 2, 5] : [1];
  const candidates: number[] = [];
  for (let decade = Math.floor(low) - 1; decade <= Math.ceil(high) + 1; decade++) {
    for (const step of steps) candidates.push(Number(`${step}e${decade}`));
  }
  const first = candidates.findLastIndex((value) => Math.log10(value) <= low + 1e-9);
  const last = candidates.findIndex((value) => Math.log10(value) >= high - 1e-9);
  let ticks = candidates.slice(Math.max(0, first), Math.max(last, first + 1) + 1);
  const [min, max] = [ticks[0], ticks[ticks.length - 1]];
  const stride = Math.ceil(ticks.length / 6);
  ticks = ticks.filter((_, i) => i % stride === 0);
  return { label, min, max, isLogarithmic: true, ticks: ticks.map((value) => ({ value, text: text(value) })) };
}

function grid(xAxis: Axis, yAxis: Axis, x: Scale, y: Scale, width: number, bottom: number): SVGElement {
  const group = makeSvg("g", { class: "axes" });
  for (const { value, text } of xAxis.ticks) {
    group.append(makeSvg("line", { x1: x(value), x2: x(value), y1: TOP, y2: bottom }));
    group.append(makeSvg("text", { x: x(value), y: bottom + 15, "text-anchor": "middle" }, text));
  }
  for (const { value, text } of yAxis.ticks) {
    group.append(makeSvg("line", { x1: LEFT, x2: width - RIGHT, y1: y(value), y2: y(value) }));
    group.append(makeSvg("text", { x: LEFT - 6, y: y(value) + 4, "text-anchor": "end" }, text));
  }
  const middle = (TOP + bottom) / 2;
  group.append(
    makeSvg(
      "text",
      { x: (LEFT + width - RIGHT) / 2, y: bottom + 31, "text-anchor": "middle", class: "label" },
      xAxis.label,
    ),
    makeSvg(
      "text",
      { class: "label", "text-anchor": "middle", transform: `translate(11 ${middle}) rotate(-90)` },
      yAxis.label,
    ),
  );
  return group;
}

function pathOf(curve: Curve, x: Scale, y: Scale, isStepped: boolean): string {
  const parts: string[] = [];
  for (let i = 0; i < curve.x.length; i++) {
    const [px, py] = [x(curve.x[i]).toFixed(1), y(curve.y[i]).toFixed(1)];
    parts.push(i === 0 ? `M${px} ${py}` : isStepped ? `H${px}V${py}` : `L${px} ${py}`);
  }
  return parts.join("");
}

export interface PlotOptions {
  title: string;
  x: Axis;
  y: Axis;
  curves: Curve[];
  isStepped: boolean;
  marks?: { x: number; y: number; label: string }[];
  summary: string; // the plot in words
}

// Returns a figure. `width`: in pixels, about, so that its texts are as large as those of the page.
export function plot(options: PlotOptions, width: number): HTMLElement {
  const bottom = HEIGHT - BOTTOM - (options.x.label ? LABEL : 0);
  const x = scaleOf(options.x, LEFT, width - RIGHT);
  const y = scaleOf(options.y, bottom, TOP);
  const svg = makeSvg(
    "svg",
    { viewBox: `0 0 ${width} ${HEIGHT}`, role: "img", "aria-label": `${options.title}. ${options.summary}` },
    grid(options.x, options.y, x, y, width, bottom),
  );
  for (const curve of options.curves) {
    svg.append(makeSvg("path", { class: `curve ${curve.style}`, d: pathOf(curve, x, y, options.isStepped) }));
  }
  for (const mark of options.marks ?? []) {
    svg.append(
      makeSvg("circle", { class: "dot", cx: x(mark.x), cy: y(mark.y), r: 4 }, makeSvg("title", {}, mark.label)),
    );
  }
  const caption = make("figcaption", {}, make("strong", {}, options.title));
  if (options.curves.length > 1 || options.curves[0].style === "dashed") {
    const keys = options.curves.map(({ label, style }) => make("span", { class: `key ${style}` }, label));
    caption.append(make("span", { class: "keys" }, ...keys));
  }
  return make("figure", { class: "plot" }, caption, svg, make("p", { class: "muted" }, options.summary));
}
