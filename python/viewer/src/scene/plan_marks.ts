// Draws the marks of the plan. Shapes tell the status, so that the plan reads without colours too: filled wedges are localized,
// hollow ones are not certain, dashed lines are bearings, crosses are true positions.
import { sceneColors } from "../colors";
import { makeSvg } from "../dom";
import { NUM_STANDARD_DEVIATIONS } from "./ellipsoids";
import type { Ground, Vec2 } from "./ground";
import { bearingLine, describeQuery, hasBearing, hasPosition, hasTruth, type ViewData } from "./view";

const DEGREES = 180 / Math.PI;

export const number = (value: number): string => String(Number(value.toPrecision(7)));
export const pointOf = ([x, y]: Vec2): string => `${number(x)} ${number(y)}`;
export const segment = (a: Vec2, b: Vec2): string => `M${pointOf(a)}L${pointOf(b)}`;

// Returns the outline of a camera at the origin that looks along x, one unit long; a square if it looks up or down.
function wedge(extents: Float32Array, index: number, heading: number | null): string {
  if (heading === null) return "M-.4-.4H.4V.4H-.4Z";
  const [left, , right] = extents.subarray(4 * index, 4 * index + 3);
  const limited = (value: number) => (Number.isFinite(value) ? Math.min(Math.max(value, 0.25), 1.2) : 0.6);
  return `M0 0L1 ${number(limited(-left))}L1 ${number(-limited(right))}Z`;
}

function placed(place: Vec2, heading: number | null): string {
  return `translate(${pointOf(place)}) rotate(${number((heading ?? 0) * DEGREES)})`;
}

// Returns one camera: a group at its place, with an outline that keeps its size when the plan is enlarged.
function camera(at: Vec2, heading: number | null, extents: Float32Array, index: number): SVGGElement {
  const outline = makeSvg("path", { class: "plan-wedge", d: wedge(extents, index, heading) });
  return makeSvg("g", { transform: placed(at, heading) }, outline);
}

export function databaseMarks(data: ViewData, ground: Ground, images: number[]): SVGElement[] {
  const { scene } = data;
  return images.map((image) => {
    const heading = ground.heading(scene.databaseRotations, image);
    const mark = camera(ground.at(scene.databaseCentres, image), heading, scene.databaseExtents, image);
    mark.setAttribute("class", "plan-database");
    mark.append(makeSvg("title", {}, scene.databaseNames[image]));
    return mark;
  });
}

// Returns where a query's mark is; the middle of the line if only its bearing is known, null if nothing is.
export function placeOf({ scene }: ViewData, ground: Ground, query: number): Vec2 | null {
  if (hasPosition(scene, query)) return ground.at(scene.queryCentres, query);
  if (!hasBearing(scene, query)) return null;
  const line = bearingLine(scene, query);
  const [a, b] = [ground.at(line, 0), ground.at(line, 1)];
  return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
}

export function queryMark(data: ViewData, ground: Ground, query: number): SVGGElement {
  const { scene, summary, queries } = data;
  const isLocalized = summary.statuses[queries.status[query]].name === "LOCALIZED";
  const text = describeQuery(data, query);
  const mark = makeSvg("g", { role: "button", tabindex: -1, "data-query": query, "aria-label": text }, makeSvg("title", {}, text));
  if (hasPosition(scene, query)) {
    const heading = ground.heading(scene.queryRotations, query);
    const wedge = camera(ground.at(scene.queryCentres, query), heading, scene.queryExtents, query);
    wedge.prepend(makeSvg("circle", { class: "plan-hit", r: 0.5 })); // Makes the apex easy to hit.
    mark.append(wedge);
    mark.setAttribute("class", isLocalized ? "plan-query" : "plan-query plan-hollow");
  } else {
    const line = bearingLine(scene, query);
    const d = segment(ground.at(line, 0), ground.at(line, 1));
    mark.append(makeSvg("path", { class: "plan-reach", d }), makeSvg("path", { class: "plan-bearing", d }));
    mark.setAttribute("class", "plan-query");
  }
  return mark;
}

// Returns the error ellipse of a query, enlarged by `factor`; null if it is not known.
export function ellipseMark({ scene }: ViewData, ground: Ground, query: number, factor: number): SVGElement | null {
  const { long, short, angle } = ground.ellipse(scene.queryCovariances.subarray(6 * query, 6 * query + 6));
  if (!hasPosition(scene, query) || !Number.isFinite(long)) return null;
  const scale = NUM_STANDARD_DEVIATIONS * factor;
  const transform = placed(ground.at(scene.queryCentres, query), angle);
  return makeSvg("ellipse", { class: "plan-ellipse", transform, rx: number(scale * long), ry: number(scale * short) });
}

// Returns crosses at the true positions, and lines from the estimated ones.
export function truthMarks({ scene }: ViewData, ground: Ground, queries: number[]): SVGElement[] {
  const known = queries.filter((query) => hasTruth(scene, query));
  const color = sceneColors().truth;
  const lines = known
    .filter((query) => hasPosition(scene, query))
    .map((query) => segment(ground.at(scene.queryCentres, query), ground.at(scene.trueCentres, query)));
  const crosses = known.map((query) =>
    makeSvg(
      "g",
      { transform: placed(ground.at(scene.trueCentres, query), null) },
      makeSvg("path", { class: "plan-wedge", d: "M-.3-.3L.3 .3M-.3 .3L.3-.3" }),
    ),
  );
  return [makeSvg("path", { class: "plan-line", d: lines.join(""), stroke: color }), makeSvg("g", { stroke: color }, ...crosses)];
}

// Returns lines between pairs of cameras that one frame or trajectory joins.
export function connectionPath(pairs: Uint32Array, centres: Float32Array, ground: Ground, isShown: (index: number) => boolean): string {
  const lines: string[] = [];
  for (let i = 0; i < pairs.length; i += 2) {
    if (isShown(pairs[i]) && isShown(pairs[i + 1])) lines.push(segment(ground.at(centres, pairs[i]), ground.at(centres, pairs[i + 1])));
  }
  return lines.join("");
}

// Returns points as dots of one path, because a page of many elements is slow.
export function pointPath(points: Float32Array, ground: Ground, count: number): string {
  const step = Math.max(1, points.length / 3 / count);
  const dots: string[] = [];
  for (let i = 0; 3 * i < points.length; i += step) dots.push(`M${pointOf(ground.at(points, Math.floor(i)))}h0`);
  return dots.join("");
}
