// Makes the plots of the head: how errors or standard deviations are distributed, and how risk falls with confidence.
import type { Plot, Queries, Summary } from "./data";
import { formatCount, formatDegrees, formatLength, formatNumber, formatPercent } from "./format";
import { type Curve, logAxis, percentAxis, plot, type PlotOptions } from "./plots";

const MAX_NUM_STEPS = 400;

interface Quantity {
  title: string;
  values: Float32Array;
  format: (value: number) => string;
}

// Returns how many of all queries have at most each value, in at most MAX_NUM_STEPS steps.
function cumulative(values: number[], numQueries: number, label: string, style: "solid" | "dashed"): Curve {
  const stride = Math.max(1, Math.ceil(values.length / MAX_NUM_STEPS));
  const curve: Curve = { label, style, x: [values[0]], y: [0] };
  values.forEach((value, i) => {
    if (i % stride !== 0 && i !== values.length - 1) return;
    curve.x.push(value);
    curve.y.push((i + 1) / numQueries);
  });
  return curve;
}

function sortedValues(values: Float32Array, isWanted: (query: number) => boolean): number[] {
  const known = values.filter((value, query) => value > 0 && Number.isFinite(value) && isWanted(query));
  return Array.from(known.sort());
}

function inWords(values: number[], numQueries: number, format: (value: number) => string): string {
  if (values.length === 1) return `One query: ${format(values[0])}.`;
  const at = (share: number) => format(values[Math.min(values.length - 1, Math.ceil(share * values.length) - 1)]);
  const whom =
    values.length === numQueries ? "of all queries" : `of the ${formatCount(values.length)} queries that have one`;
  return `Half ${whom} are below ${at(0.5)}, 90 % below ${at(0.9)}.`;
}

function distribution(quantity: Quantity, summary: Summary, queries: Queries): PlotOptions | null {
  const { values, format, title } = quantity;
  const lowConfidence = summary.statuses.findIndex(({ name }) => name === "LOW_CONFIDENCE");
  const all = sortedValues(values, () => true);
  const trusted = sortedValues(values, (query) => queries.status[query] !== lowConfidence);
  if (all.length === 0) return null;
  const curves: Curve[] = [];
  if (trusted.length > 0) curves.push(cumulative(trusted, summary.numQueries, "localized", "solid"));
  if (trusted.length < all.length) {
    curves.push(cumulative(all, summary.numQueries, "with low confidence", "dashed"));
  }
  const x = logAxis("", [all[0], all[all.length - 1]], (value) => format(value));
  for (const curve of curves) {
    curve.x.push(x.max);
    curve.y.push(curve.y[curve.y.length - 1]);
  }
  const shown = trusted.length > 0 ? trusted : all;
  const words = inWords(shown, summary.numQueries, format);
  return { title, x, y: percentAxis("% of all queries"), curves, isStepped: true, summary: words };
}

function riskCoverage({ confidence, coverage, risk }: Plot, summary: Summary): PlotOptions {
  const max = Math.max(0.05, ...risk);
  const accepted = confidence.findLastIndex((value) => value >= summary.minConfidence);
  const marks = [];
  let words = `No query reaches the threshold of ${formatNumber(summary.minConfidence, 2)}.`;
  if (accepted >= 0) {
    const at = `at the threshold of ${formatNumber(summary.minConfidence, 2)}`;
    words = `${formatPercent(coverage[accepted])} are accepted ${at}; ${formatPercent(risk[accepted])} of these are wrong.`;
    marks.push({ x: coverage[accepted], y: risk[accepted], label: words });
  }
  if (summary.auroc !== null) words += ` Area under the ROC curve: ${formatNumber(summary.auroc)}.`;
  return {
    title: "Risk and coverage",
    x: percentAxis("% accepted, the surest first"),
    y: percentAxis("% of these wrong", max),
    curves: [{ label: "", x: coverage, y: risk, style: "solid" }],
    isStepped: false,
    marks,
    summary: words.trim(),
  };
}

export function headPlots(summary: Summary, queries: Queries): HTMLElement[] {
  const round = (value: number) => formatLength(value, summary, 1);
  const length = (value: number) =>
    Number(value.toPrecision(1)) === value ? round(value) : formatLength(value, summary);
  const degrees = (value: number) => formatDegrees(value, Number(value.toPrecision(1)) === value ? 1 : 2);
  const quantities: Quantity[] = summary.hasTruth
    ? [
        { title: "Position error", values: queries.positionError, format: length },
        { title: "Orientation error", values: queries.rotationErrorDeg, format: degrees },
      ]
    : [
        { title: "Standard deviation of the position", values: queries.positionStddev, format: length },
        { title: "Standard deviation of the orientation", values: queries.rotationStddevDeg, format: degrees },
      ];
  const plots = quantities.map((quantity) => distribution(quantity, summary, queries));
  if (summary.riskCoverage) plots.push(riskCoverage(summary.riskCoverage, summary));
  const known = plots.filter((options): options is PlotOptions => options !== null);
  return known.map((options) => plot(options, known.length > 2 ? 300 : 460));
}
