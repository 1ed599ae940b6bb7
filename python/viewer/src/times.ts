// Shows how long each stage of a query took, as one bar.
import type { Details } from "./data";
import { make } from "./dom";
import { formatPercent, formatSeconds } from "./format";

const MIN_SHARE = 0.03; // smaller stages are joined
const COLORS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#b3a400", "#7a5195", "#8c6d46"];
const REST_COLOR = "#8a8f98";

const LABELS: Record<string, string> = {
  load: "reading",
  two_view: "two-view geometry",
  observations: "observations",
  rotation: "rotation averaging",
  directions: "directions",
  translation: "translation averaging",
  tracks: "tracks",
  start: "starting pose",
  triangulation: "triangulation",
  adjustment: "bundle adjustment",
  covariance: "covariance",
  confidence: "confidence",
};

export function timeBar(details: Details, row: number): HTMLElement | null {
  const num = details.stages.length;
  const stages = details.stages.map((stage, i) => ({
    label: LABELS[stage] ?? stage.replaceAll("_", " "),
    seconds: details.seconds[row * num + i],
  }));
  const known = stages.filter(({ seconds }) => seconds > 0);
  const total = known.reduce((sum, { seconds }) => sum + seconds, 0);
  if (total === 0) return null;
  const large = known.filter(({ seconds }) => seconds >= MIN_SHARE * total);
  const rest = total - large.reduce((sum, { seconds }) => sum + seconds, 0);
  const parts = large.map((stage, i) => ({ ...stage, color: COLORS[i % COLORS.length] }));
  if (rest > 0 && large.length < known.length) parts.push({ label: "other", seconds: rest, color: REST_COLOR });
  const bar = make("div", { class: "times", role: "img", "aria-label": `Time: ${formatSeconds(total)}` });
  const legend = make("ul", { class: "legend" });
  for (const { label, seconds, color } of parts) {
    const text = `${label} ${formatSeconds(seconds)}`;
    const segment = make("span", { title: `${text}, ${formatPercent(seconds / total)}` });
    segment.style.flexGrow = String(seconds / total);
    segment.style.background = color;
    bar.append(segment);
    const swatch = make("span", { class: "swatch" });
    swatch.style.background = color;
    legend.append(make("li", {}, swatch, text));
  }
  return make("section", {}, make("h3", {}, `Computing time: ${formatSeconds(total)}`), bar, legend);
}
