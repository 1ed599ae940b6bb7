// Draws the photo of a query beside database images, with lines between matched keypoints and arrows of residuals.
import type { Drawing, Scene } from "./data";
import { make, makeSvg, visibleText } from "./dom";
import { formatCount, formatNumber } from "./format";
import { photoUrl } from "./load";

const MAX_NUM_LINES = 70; // of each database image
const WIDTH = 1000; // units of the figure
const MAX_HEIGHT = 640;
const GAP = 46;
const INNER_GAP = 14;
const CAPTION = 22;
const STACK_HEIGHT = 1.3; // of the database images together, in heights of the query
const ARROW_LENGTH = 0.045; // of the query's width: that of the residual that 90 % stay below

interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
  scale: number; // figure units per pixel
}

type Point = [x: number, y: number];

function boxOf(x: number, y: number, size: [number, number], scale: number): Box {
  return { x, y, width: size[0] * scale, height: size[1] * scale, scale };
}

// Places the query at the left and the database images, one below the other, at its right; upright ones side by side.
function layout(query: [number, number], others: [number, number][]): { boxes: Box[]; width: number; height: number } {
  const aspect = ([width, height]: [number, number]) => width / height;
  const isUpright = others.every((size) => aspect(size) < 1) && aspect(query) < 1;
  if (isUpright || others.length < 2) return sideBySide(query, others, aspect);
  // A database image of height h is aspect * h wide.
  const num = others.length;
  const widest = Math.max(...others.map(aspect));
  const gaps = (num - 1) * (INNER_GAP + CAPTION);
  const room = WIDTH - GAP + (widest * gaps) / num;
  const height = Math.min(MAX_HEIGHT, room / (aspect(query) + (widest * STACK_HEIGHT) / num));
  const each = (STACK_HEIGHT * height - gaps) / num;
  const boxes = [boxOf(0, 0, query, height / query[1])];
  others.forEach((size, i) => {
    boxes.push(boxOf(boxes[0].width + GAP, i * (each + INNER_GAP + CAPTION), size, each / size[1]));
  });
  return { boxes, width: boxes[0].width + GAP + widest * each, height: STACK_HEIGHT * height + CAPTION };
}

function sideBySide(query: [number, number], others: [number, number][], aspect: (size: [number, number]) => number) {
  const sizes = [query, ...others];
  const room = WIDTH - GAP - INNER_GAP * Math.max(0, others.length - 1);
  const height = Math.min(MAX_HEIGHT * 0.75, room / sizes.reduce((sum, size) => sum + aspect(size), 0));
  let x = 0;
  const boxes = sizes.map((size, i) => {
    const box = boxOf(x, 0, size, height / size[1]);
    x += box.width + (i === 0 ? GAP : INNER_GAP);
    return box;
  });
  const last = boxes[boxes.length - 1];
  return { boxes, width: last.x + last.width, height: height + CAPTION };
}

function place(box: Box, xy: Float32Array, i: number): Point {
  return [box.x + xy[2 * i] * box.scale, box.y + xy[2 * i + 1] * box.scale];
}

const pair = ([x, y]: Point) => `${x.toFixed(1)} ${y.toFixed(1)}`;

function photo(box: Box, index: number, name: string, remark = ""): SVGElement {
  const rect = { x: box.x, y: box.y, width: box.width, height: box.height };
  const url = photoUrl(index);
  const group = makeSvg("g", { class: "photo" }, makeSvg("rect", rect));
  if (url) group.append(makeSvg("image", { href: url, preserveAspectRatio: "none", ...rect }));
  group.append(caption(box, name, remark));
  return group;
}

// Returns a name, without its beginning if it is long, and a remark.
function caption(box: Box, name: string, remark: string): SVGElement {
  const maxLength = Math.max(8, Math.floor(box.width / 6.6) - remark.length);
  const text = name.length > maxLength ? `\u2026${name.slice(1 - maxLength)}` : name;
  return makeSvg("text", { x: box.x, y: box.y + box.height + 15 }, text + remark, makeSvg("title", {}, name));
}

interface Matches {
  images: Uint8Array;
  xy: Float32Array;
  databaseXy: Float32Array;
}

function strideOf(num: number): number {
  return Math.max(1, Math.ceil(num / MAX_NUM_LINES));
}

// Returns lines from the query to one database image, every n-th if there are many, and a dot at each end.
function lines(matches: Matches, image: number, boxes: Box[], kind: string): SVGElement {
  const chosen: number[] = [];
  matches.images.forEach((value, i) => {
    if (value === image) chosen.push(i);
  });
  const stride = strideOf(chosen.length);
  const strokes: string[] = [];
  const dots: string[] = [];
  chosen.forEach((i, position) => {
    const from = pair(place(boxes[0], matches.xy, i));
    const to = pair(place(boxes[image + 1], matches.databaseXy, i));
    dots.push(`M${from}h0M${to}h0`);
    if (position % stride === 0) strokes.push(`M${from}L${to}`);
  });
  const width = Math.max(2, Math.min(4, 4 * Math.sqrt(150 / (chosen.length + 1))));
  const opacity = Math.max(0.35, Math.min(0.8, 3.5 / Math.sqrt(strokes.length + 1)));
  return makeSvg(
    "g",
    { class: `matches ${kind} image-${image}` },
    makeSvg("path", { class: "lines", d: strokes.join(""), "stroke-opacity": opacity.toFixed(2) }),
    makeSvg("path", { class: "dots", d: dots.join(""), "stroke-width": width.toFixed(1) }),
  );
}

// Returns a factor of 1, 2 or 5 times a power of ten that makes residuals visible.
function residualFactor(drawing: Drawing): number {
  const lengths = Float64Array.from({ length: drawing.residuals.length / 2 }, (_, i) =>
    Math.hypot(drawing.residuals[2 * i], drawing.residuals[2 * i + 1]),
  ).sort();
  const length = lengths[Math.floor(0.9 * (lengths.length - 1))];
  if (!(length > 0)) return 1;
  const factor = (ARROW_LENGTH * drawing.size[0]) / length;
  const decade = 10 ** Math.floor(Math.log10(factor));
  return Math.max(1, [5, 2, 1].map((step) => step * decade).find((step) => step <= factor) ?? decade);
}

function arrows(drawing: Drawing, box: Box, factor: number): SVGElement {
  const parts: string[] = [];
  for (let i = 0; i < drawing.residuals.length / 2; i++) {
    const from = place(box, drawing.residualXy, i);
    const [dx, dy] = [0, 1].map((axis) => drawing.residuals[2 * i + axis] * factor * box.scale);
    const to: Point = [from[0] + dx, from[1] + dy];
    const barb = (turn: number): Point => [
      to[0] - 0.3 * (dx * Math.cos(turn) - dy * Math.sin(turn)),
      to[1] - 0.3 * (dx * Math.sin(turn) + dy * Math.cos(turn)),
    ];
    parts.push(`M${pair(from)}L${pair(to)}M${pair(barb(0.5))}L${pair(to)}L${pair(barb(-0.5))}`);
  }
  const path = parts.join("");
  return makeSvg(
    "g",
    { class: "residuals" },
    makeSvg("path", { class: "halo", d: path }),
    makeSvg("path", { class: "arrows", d: path }),
  );
}

// Returns a switch that shows or hides the parts of a figure that have this class.
function toggle(figure: HTMLElement, kind: string, label: string, isOn: boolean): HTMLElement {
  const box = make("input", { type: "checkbox", checked: isOn });
  const show = () => figure.classList.toggle(`with-${kind}`, box.checked);
  box.addEventListener("change", show);
  show();
  return make("label", { class: `toggle ${kind}` }, box, make("span", { class: "swatch" }), label);
}

export interface Figure {
  element: HTMLElement;
  highlight(image: number): void; // lets only the lines to this database image stand out; -1: all
}

export function makeFigure(drawing: Drawing, name: string, photoIndex: number, scene: Scene): Figure {
  const { boxes, width, height } = layout(
    drawing.size,
    drawing.images.map(({ size }) => size),
  );
  const svg = makeSvg("svg", {
    viewBox: `-1 -1 ${width + 2} ${height + 2}`,
    role: "img",
    preserveAspectRatio: "xMinYMin",
  });
  svg.setAttribute("aria-label", `${name} beside the database images that share most points with it`);
  svg.append(photo(boxes[0], photoIndex, visibleText(name)));
  const figure = make("figure", { class: "drawing" });
  figure.style.setProperty("--width", `${Math.round(width)}px`);
  drawing.images.forEach(({ image, photo: index, numInliers }, i) => {
    const remark = ` \u00b7 ${formatCount(numInliers)} inliers`;
    const element = photo(boxes[i + 1], index, visibleText(scene.databaseNames[image] ?? ""), remark);
    element.addEventListener("pointerenter", () => highlight(i));
    element.addEventListener("pointerleave", () => highlight(-1));
    svg.append(element);
  });
  const rejected = { images: drawing.rejectedImages, xy: drawing.rejectedXy, databaseXy: drawing.rejectedDatabaseXy };
  const inliers = { images: drawing.inlierImages, xy: drawing.inlierXy, databaseXy: drawing.inlierDatabaseXy };
  drawing.images.forEach((_, i) => svg.append(lines(rejected, i, boxes, "rejected")));
  drawing.images.forEach((_, i) => svg.append(lines(inliers, i, boxes, "inliers")));
  const factor = residualFactor(drawing);
  if (drawing.residuals.length > 0) svg.append(arrows(drawing, boxes[0], factor));
  const highlight = (image: number) => {
    svg.dataset.image = String(image);
    svg.querySelectorAll(".matches").forEach((group) => {
      group.classList.toggle("faded", image >= 0 && !group.classList.contains(`image-${image}`));
    });
  };
  figure.append(switches(figure, drawing, factor), svg);
  return { element: figure, highlight };
}

// Returns the number of matches, and how many of them have a line.
function matchText(images: Uint8Array): string {
  const counts = [0, 0, 0];
  for (const image of images) counts[image]++;
  const numLines = counts.reduce((sum, count) => sum + Math.ceil(count / strideOf(count)), 0);
  const all = formatCount(images.length);
  return numLines < images.length ? `${all}, ${formatCount(numLines)} with lines` : all;
}

function switches(figure: HTMLElement, drawing: Drawing, factor: number): HTMLElement {
  const bar = make("div", { class: "bar switches" });
  const { inlierImages, rejectedImages, residuals } = drawing;
  if (inlierImages.length > 0) {
    bar.append(toggle(figure, "inliers", `Inliers (${matchText(inlierImages)})`, true));
  }
  if (rejectedImages.length > 0) {
    // Call them matches where the run has no points of this query, because then none was judged.
    const isJudged = inlierImages.length > 0;
    const label = isJudged ? "Rejected matches" : "Matches";
    bar.append(toggle(figure, "rejected", `${label} (${matchText(rejectedImages)})`, !isJudged));
  }
  if (residuals.length > 0) {
    const text = `Residuals, ${formatNumber(factor, 1)} times as long as in the photo`;
    bar.append(toggle(figure, "residuals", text, false));
  }
  return bar;
}
