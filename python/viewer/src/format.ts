// Writes numbers for people: two or three significant digits, units with prefixes, an en dash for what is unknown.
import type { Summary } from "./data";

export const UNKNOWN = "\u2013";
const NARROW_SPACE = "\u202f";

// Returns a number with `digits` significant digits and no exponent between 1e-4 and 1e7.
export function formatNumber(value: number, digits = 3): string {
  if (Number.isNaN(value)) return UNKNOWN;
  if (!Number.isFinite(value)) return value > 0 ? "\u221e" : "\u2212\u221e";
  if (value === 0) return "0";
  const magnitude = Math.floor(Math.log10(Math.abs(rounded(value, digits))));
  if (magnitude < -4 || magnitude >= 7) return withExponent(value, digits);
  const text = value.toFixed(Math.max(0, Math.min(100, digits - 1 - magnitude)));
  return text.replace("-", "\u2212");
}

function rounded(value: number, digits: number): number {
  return Number(value.toPrecision(digits));
}

const SUPERSCRIPTS = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079";

function withExponent(value: number, digits: number): string {
  const [mantissa, exponent] = value
    .toExponential(digits - 1)
    .replace("+", "")
    .split("e");
  const raised = exponent.replace(/\d/g, (digit) => SUPERSCRIPTS[Number(digit)]).replace("-", "\u207b");
  return `${mantissa.replace("-", "\u2212")}\u00b710${raised}`;
}

export function formatCount(value: number): string {
  return value < 0 || Number.isNaN(value) ? UNKNOWN : groupThousands(String(Math.round(value)));
}

function groupThousands(digits: string): string {
  return digits.length <= 4 ? digits : digits.replace(/\B(?=(\d{3})+$)/g, NARROW_SPACE);
}

// Returns what stands behind a number: nothing for units of the model, of which the head of the page speaks.
export function shownUnit(unit: string): string {
  return unit === "units" ? "" : unit;
}

// Returns the prefixed unit for lengths of about this size, and its length in units.
export function lengthUnit(value: number, summary: Summary): { unit: string; length: number } {
  const size = Math.abs(value);
  if (summary.unit !== "m") return { unit: shownUnit(summary.unit), length: 1 };
  if (size >= 10000) return { unit: "km", length: 1000 };
  if (size >= 1 || size === 0 || !Number.isFinite(size)) return { unit: "m", length: 1 };
  if (size >= 0.01) return { unit: "cm", length: 0.01 };
  return size >= 1e-4 ? { unit: "mm", length: 0.001 } : { unit: "\u00b5m", length: 1e-6 };
}

export function formatLength(value: number, summary: Summary, digits = 2): string {
  if (Number.isNaN(value)) return UNKNOWN;
  const { unit, length } = lengthUnit(rounded(value, digits), summary);
  const scaled = value / length;
  return withUnit(Math.abs(scaled) >= 100 ? formatNumber(scaled, 3) : formatNumber(scaled, digits), unit);
}

function withUnit(text: string, unit: string): string {
  return unit && text !== UNKNOWN ? `${text}\u00a0${unit}` : text;
}

export function formatDegrees(value: number, digits = 2): string {
  return Number.isNaN(value) ? UNKNOWN : `${formatNumber(value, digits)}\u00b0`;
}

export function formatPixels(value: number): string {
  return withUnit(formatNumber(value, 2), "px");
}

export function formatSeconds(value: number): string {
  if (value > 0 && value < 0.1) return withUnit(formatNumber(value * 1000, 2), "ms");
  return withUnit(formatNumber(value, 2), "s");
}

// Returns a probability with two digits after the point, more if that would round it to 1: 0.9994.
export function formatConfidence(value: number): string {
  if (Number.isNaN(value)) return UNKNOWN;
  if (value >= 0.995 && value < 1) return value.toFixed(4).replace(/^1\.0*$/, ">0.9999");
  return value > 0 && value < 0.005 ? "<0.01" : value.toFixed(2);
}

export function formatPercent(ratio: number): string {
  return Number.isNaN(ratio) ? UNKNOWN : `${formatNumber(100 * ratio, ratio >= 0.1 ? 3 : 2)}\u00a0%`;
}
