// Gives queries their colours: the palette of Okabe and Ito, and for numbers a scale from vermilion (bad) to blue (good),
// which colour-blind people can tell apart too. A colour is a hexadecimal string.
import type { Queries, Summary } from "./data";
import { formatLength } from "./format";

export type ColorMode = "status" | "confidence" | "error";
// `hollow` stands for a frustum that is drawn as an outline only.
export type LegendEntry = { color: string; label: string; hollow?: boolean };

const STATUS_COLORS: Record<string, [light: string, dark: string]> = {
  LOCALIZED: ["#0072b2", "#4aa8e0"],
  LOW_CONFIDENCE: ["#c77f00", "#e69f00"],
  SCALE_UNOBSERVABLE: ["#b0558a", "#cc79a7"],
};
const FAILURE_COLOR: [light: string, dark: string] = ["#d55e00", "#f0752a"];
// Lists the colours of the scale, worst first: light mode, dark mode.
const SCALE: [light: string, dark: string][] = [
  ["#d55e00", "#f0752a"],
  ["#e69f00", "#e69f00"],
  ["#c9b400", "#f0e442"],
  ["#56b4e9", "#56b4e9"],
  ["#0072b2", "#2f8fd0"],
];
const UNKNOWN_COLOR: [light: string, dark: string] = ["#777777", "#9a9a9a"];
const CONFIDENCE_BOUNDS = [0.25, 0.5, 0.75]; // and Summary.minConfidence
const ERROR_QUANTILES = [0.95, 0.75, 0.5, 0.25];

export function isDark(): boolean {
  return window.matchMedia("(prefers-color-scheme: dark)").matches;
}

const shade = (pair: [string, string]) => pair[isDark() ? 1 : 0];

export function statusColor(name: string): string {
  return shade(STATUS_COLORS[name] ?? FAILURE_COLOR);
}

// Returns database frustums', truth's and selected things' colours, for scene and plan alike.
export function sceneColors(): Record<"database" | "truth" | "selected" | "rays" | "links" | "changes" | "control", string> {
  return isDark()
    ? { database: "#8b929c", truth: "#dddddd", selected: "#ffffff", rays: "#2fc79a", links: "#d59bc0", changes: "#ff8c42", control: "#f0e442" }
    : { database: "#8a8f98", truth: "#333333", selected: "#111111", rays: "#009e73", links: "#a2508a", changes: "#c2410c", control: "#8a7400" };
}

const errorBoundsOf = new WeakMap<Queries, number[]>();

// Returns the errors at which the colour changes, the largest first: quantiles of this run's errors.
function errorBounds(queries: Queries): number[] {
  let bounds = errorBoundsOf.get(queries);
  if (!bounds) {
    const errors = queries.positionError.filter((error) => !Number.isNaN(error)).sort();
    bounds = ERROR_QUANTILES.map((quantile) => errors[Math.floor(quantile * (errors.length - 1))] ?? NaN);
    bounds = bounds.map((bound) => Number(bound.toPrecision(2)));
    errorBoundsOf.set(queries, bounds);
  }
  return bounds;
}

function confidenceBounds({ minConfidence }: Summary): number[] {
  return [...CONFIDENCE_BOUNDS.filter((bound) => bound < minConfidence), minConfidence];
}

function stepOf(value: number, bounds: number[], isBetter: (value: number, bound: number) => boolean): number {
  let step = 0;
  while (step < bounds.length && isBetter(value, bounds[step])) step++;
  return step;
}

export function queryColor(mode: ColorMode, queries: Queries, summary: Summary, index: number): string {
  if (mode === "status") return statusColor(summary.statuses[queries.status[index]].name);
  const value = mode === "confidence" ? queries.confidence[index] : queries.positionError[index];
  if (Number.isNaN(value)) return shade(UNKNOWN_COLOR);
  const step =
    mode === "confidence"
      ? stepOf(value, confidenceBounds(summary), (confidence, bound) => confidence >= bound)
      : stepOf(value, errorBounds(queries), (error, bound) => error <= bound);
  return shade(SCALE[step]);
}

function errorLegend(queries: Queries, summary: Summary): LegendEntry[] {
  const bounds = errorBounds(queries).map((bound) => formatLength(bound, summary));
  const entries = bounds.map((bound, i) => ({
    color: shade(SCALE[i]),
    label: i === 0 ? `over ${bound}` : `to ${bounds[i - 1]}`,
  }));
  entries.push({ color: shade(SCALE[bounds.length]), label: `to ${bounds[bounds.length - 1]}` });
  return entries.reverse();
}

function statusEntry(name: string): LegendEntry {
  return { color: statusColor(name), label: statusLabel(name), hollow: name === "LOW_CONFIDENCE" };
}

// Returns what the colours of a mode mean, the best first.
export function legend(mode: ColorMode, queries: Queries, summary: Summary): LegendEntry[] {
  if (mode === "status") {
    const names = summary.statuses.map(({ name }) => name);
    const entries = names.filter((name) => name in STATUS_COLORS).map(statusEntry);
    return entries.length < names.length
      ? [...entries, { color: shade(FAILURE_COLOR), label: "no position" }]
      : entries;
  }
  if (mode === "error") return [...errorLegend(queries, summary), { color: shade(UNKNOWN_COLOR), label: "unknown" }];
  const bounds = confidenceBounds(summary);
  const entries = bounds.map((bound, i) => ({ color: shade(SCALE[i]), label: `below ${bound}` }));
  entries.push({ color: shade(SCALE[SCALE.length - 1]), label: `from ${bounds[bounds.length - 1]}` });
  return [...entries.reverse(), { color: shade(UNKNOWN_COLOR), label: "none" }];
}

// Returns a status in words: its own name, as docs/formats.md lists it.
export function statusLabel(name: string): string {
  return name.toLowerCase().replaceAll("_", " ");
}
