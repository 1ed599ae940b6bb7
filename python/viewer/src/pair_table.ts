// Lists the database images that share matches with a query, with bars for inliers and errors.
import type { Details, Scene } from "./data";
import { help, make, nameParts, visibleText } from "./dom";
import { formatCount, formatDegrees } from "./format";

const NUM_SHOWN = 12;

interface Pair {
  image: number;
  numInliers: number;
  isUsed: boolean;
  rotationErrorDeg: number;
  directionErrorDeg: number;
}

type Maxima = Pick<Pair, "numInliers" | "rotationErrorDeg" | "directionErrorDeg">;

function pairsOf(details: Details, row: number): Pair[] {
  const pairs: Pair[] = [];
  for (let i = details.pairOffsets[row]; i < details.pairOffsets[row + 1]; i++) {
    pairs.push({
      image: details.pairImages[i],
      numInliers: details.pairNumInliers[i],
      isUsed: details.pairIsUsed[i] === 1,
      rotationErrorDeg: details.pairRotationErrorsDeg[i],
      directionErrorDeg: details.pairDirectionErrorsDeg[i],
    });
  }
  const rank = (pair: Pair) => pair.numInliers + (pair.isUsed ? 1e9 : 0);
  return pairs.sort((a, b) => rank(b) - rank(a));
}

function bar(kind: string, text: string, ratio: number): HTMLElement {
  const cell = make("td", { class: `bar-cell ${kind}` }, make("span", {}, text));
  cell.style.setProperty("--ratio", Number.isNaN(ratio) ? "0" : Math.min(1, ratio).toFixed(3));
  return cell;
}

function tableRow(pair: Pair, scene: Scene, max: Maxima, onPoint: (image: number) => void): HTMLElement {
  const name = visibleText(scene.databaseNames[pair.image] ?? "");
  const row = make(
    "tr",
    { class: pair.isUsed ? "" : "unused", title: pair.isUsed ? null : "not used for the pose" },
    make("th", { scope: "row", title: name, "aria-label": name }, make("span", { class: "cut-name" }, ...nameParts(name))),
    bar("inliers", formatCount(pair.numInliers), pair.numInliers / max.numInliers),
    bar("angle", formatDegrees(pair.rotationErrorDeg), pair.rotationErrorDeg / max.rotationErrorDeg),
    bar("angle", formatDegrees(pair.directionErrorDeg), pair.directionErrorDeg / max.directionErrorDeg),
  );
  row.addEventListener("pointerenter", () => onPoint(pair.image));
  row.addEventListener("pointerleave", () => onPoint(-1));
  return row;
}

function header(label: string, explanation: string): HTMLElement {
  return make("th", { scope: "col" }, label, help(explanation));
}

// Returns a section. `onPoint` hears which database image the pointer is at, or -1.
export function pairTable(details: Details, row: number, scene: Scene, onPoint: (image: number) => void): HTMLElement {
  const pairs = pairsOf(details, row);
  if (pairs.length === 0) {
    return make("p", { class: "muted" }, "No database image shares matches with this query.");
  }
  const largest = (key: keyof Maxima) =>
    Math.max(1e-9, ...pairs.map((pair) => pair[key]).filter((x) => !Number.isNaN(x)));
  const max: Maxima = {
    numInliers: largest("numInliers"),
    rotationErrorDeg: largest("rotationErrorDeg"),
    directionErrorDeg: largest("directionErrorDeg"),
  };
  const numUsed = pairs.filter((pair) => pair.isUsed).length;
  const head = make(
    "tr",
    {},
    make("th", { scope: "col" }, "Database image"),
    header("Inliers", "Matches that agree with one relative pose of the two images."),
    header("Rotation", "How far the relative orientation to this image is from the pose that was found."),
    header("Direction", "How far the direction to this image is from the pose that was found."),
  );
  const rows = pairs.map((pair) => tableRow(pair, scene, max, onPoint));
  const body = make("tbody", {}, ...rows.slice(0, NUM_SHOWN));
  const table = make("table", { class: "pair-table" }, make("thead", {}, head), body);
  const title = `Database images (${formatCount(pairs.length)}, ${formatCount(numUsed)} used)`;
  const section = make("section", {}, make("h3", {}, title), table);
  if (rows.length > NUM_SHOWN) {
    const more = make(
      "button",
      { type: "button", class: "button more" },
      `Show ${formatCount(rows.length - NUM_SHOWN)} more`,
    );
    more.addEventListener("click", () => {
      body.append(...rows.slice(NUM_SHOWN));
      more.remove();
    });
    section.append(more);
  }
  return section;
}
