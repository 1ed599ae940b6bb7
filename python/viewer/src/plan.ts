// Shows the scene from above as SVG: for browsers without WebGL, and for paper.
import { queryColor, sceneColors, type ColorMode } from "./colors";
import { button, make, makeSvg } from "./dom";
import { formatCount, formatLength } from "./format";
import { suggestFactor } from "./scene/ellipsoids";
import { boxOf, Ground, thin, type Box, type Vec2 } from "./scene/ground";
import { PlanControls } from "./scene/plan_controls";
import { drawFrame, drawScale, type Mapping } from "./scene/plan_frame";
import * as marks from "./scene/plan_marks";
import { hasPosition, usedDatabaseImages, type SceneView, type ViewData, type ViewState } from "./scene/view";
import type { Selection } from "./selection";

const MAX_NUM_QUERIES = 5000;
const MAX_NUM_IMAGES = 1500;
const MAX_NUM_POINTS = 6000;
const MAX_NUM_RAYS = 400;
const APEX_PIXELS = 6; // So near an apex a click means it.
const MARK_PIXELS = 15;
const MIN_MARK_PIXELS = 5;
const MAX_NUM_LARGE_MARKS = 150; // More marks than this are drawn smaller until the plan is enlarged.
const PAPER: Vec2 = [1000, 620]; // Size of the picture while the host has none, as before printing.
const LAYERS = ["frame", "points", "database", "lines", "rays", "ellipses", "truth", "queries", "links"] as const;
const HELP = "Arrow keys move the plan, plus and minus zoom, Home fits. Tab leads to a query, from which arrow keys lead to others.";

class PlanView implements SceneView {
  private readonly ground: Ground;
  private readonly box: Box;
  private readonly factor: number;
  private readonly svg = makeSvg("svg", { class: "plan-svg", role: "group", tabindex: 0 });
  private readonly world = makeSvg("g");
  private readonly frame = makeSvg("g", { "aria-hidden": "true" });
  private readonly scale = makeSvg("g", { "aria-hidden": "true" });
  private readonly layers = Object.fromEntries(LAYERS.map((name) => [name, makeSvg("g", { class: `plan-${name}` })]));
  private readonly caption = make("p", { class: "plan-caption" });
  private readonly resizes = new ResizeObserver(() => this.resize());
  private readonly queryMarks = new Map<number, SVGGElement>();
  private mapping: Mapping = { width: PAPER[0], height: PAPER[1], scale: 1, shift: [0, 0] };
  private isShown: Uint8Array;
  private mode: ColorMode = "status";
  private fittedScale = 1;
  private numPlaced = 0;
  private redrawTimer = 0;
  private isChanged = false; // True if the user moved the plan
  private isDisposed = false;

  constructor(
    private readonly host: HTMLElement,
    private readonly data: ViewData,
    private readonly selection: Selection,
  ) {
    const { scene, queries, summary } = data;
    this.ground = new Ground(scene);
    this.factor = suggestFactor(scene);
    this.isShown = new Uint8Array(queries.names.length).fill(1);
    this.box = boxOf(scene, this.ground);
    this.svg.setAttribute("aria-label", `Plan of ${summary.numQueries} queries. ${HELP}`);
    this.world.append(...LAYERS.map((name) => this.layers[name]));
    this.svg.append(this.frame, this.world, this.scale);
    const fit = button("Fit", () => this.fit());
    host.append(this.svg, make("div", { class: "scene-buttons plan-buttons" }, fit), this.caption);
    new PlanControls(this.svg, {
      zoom: (factor, at) => this.zoom(factor, at),
      pan: (x, y) => this.pan(x, y),
      fit: () => this.fit(),
      click: (at, target) => this.click(at, target),
      focusNext: (from, direction) => this.focusNext(this.markOf(from), direction),
      press: (target) => this.pickMark(this.markOf(target)),
    });
    this.resize();
    this.drawBackground();
    this.drawQueries();
    this.fit(); // Leaves room for the caption, whose height is known now.
    selection.onChange((query) => this.select(query));
    this.resizes.observe(host);
    this.select(selection.query);
  }

  private drawBackground(): void {
    const { scene } = this.data;
    const colors = sceneColors();
    const d = marks.pointPath(scene.points, this.ground, MAX_NUM_POINTS);
    this.layers.points.replaceChildren(makeSvg("path", { class: "plan-dots", d }));
    const images = [...scene.databaseNames.keys()];
    const { kept } = thin(images, MAX_NUM_IMAGES, (image) => this.ground.at(scene.databaseCentres, image), this.box);
    this.layers.database.setAttribute("stroke", colors.database);
    this.layers.database.replaceChildren(...marks.databaseMarks(this.data, this.ground, kept));
  }

  private drawQueries(): void {
    const { scene, queries } = this.data;
    const all = [...this.isShown.keys()].filter((query) => this.isShown[query] === 1);
    const placed = all.filter((query) => marks.placeOf(this.data, this.ground, query) !== null);
    this.numPlaced = placed.length;
    const place = (query: number) => marks.placeOf(this.data, this.ground, query) as Vec2;
    const box = this.isChanged && placed.length > MAX_NUM_QUERIES ? this.boxInSight() : this.box;
    const isInBox = ([x, y]: Vec2) => x >= box.least[0] && y >= box.least[1] && x <= box.most[0] && y <= box.most[1];
    const near = box === this.box ? placed : placed.filter((query) => isInBox(place(query)));
    const { kept, cell } = thin(near, MAX_NUM_QUERIES, place, box, MIN_MARK_PIXELS / this.mapping.scale);
    this.queryMarks.clear();
    for (const query of kept) this.queryMarks.set(query, marks.queryMark(this.data, this.ground, query));
    // Draws the least certain queries, which the report lists first, on top.
    this.layers.queries.replaceChildren(...[...this.queryMarks.values()].reverse());
    this.layers.truth.replaceChildren(...marks.truthMarks(this.data, this.ground, kept));
    const isDrawn = (query: number) => this.isShown[query] === 1 && hasPosition(scene, query);
    const d =
      marks.connectionPath(scene.queryConnections, scene.queryCentres, this.ground, isDrawn) +
      marks.connectionPath(scene.databaseConnections, scene.databaseCentres, this.ground, () => true);
    this.layers.lines.replaceChildren(makeSvg("path", { class: "plan-line", d, stroke: sceneColors().database }));
    this.drawEllipses(kept);
    this.describe(all.length, all.length - placed.length, kept.length, cell);
    this.paint();
    const first = this.queryMarks.get(kept[0]);
    first?.setAttribute("tabindex", "0");
    if (queries.names.length > 0) this.select(this.selection.query);
  }

  // Returns the part of the ground that the window shows, and as much again around it.
  private boxInSight(): Box {
    const { width, height, scale, shift } = this.mapping;
    const middle: Vec2 = [(width / 2 - shift[0]) / scale, (shift[1] - height / 2) / scale];
    const [x, y] = [width / scale, height / scale];
    return { least: [middle[0] - x, middle[1] - y], most: [middle[0] + x, middle[1] + y] };
  }

  private drawEllipses(queries: number[]): void {
    const shapes = queries.map((query) => {
      const shape = marks.ellipseMark(this.data, this.ground, query, this.factor);
      shape?.setAttribute("data-of", String(query));
      return shape;
    });
    this.layers.ellipses.replaceChildren(...shapes.filter((shape) => shape !== null));
  }

  private describe(numAll: number, numWithout: number, numDrawn: number, cell: number): void {
    const { summary, scene } = this.data;
    const texts = [`Seen from above; wedges open in the direction of view. Ellipses: 3 standard deviations \u00d7 ${this.factor}.`];
    if (scene.trueCentres.length > 0) texts.push("Crosses: true positions.");
    if (numWithout > 0) texts.push(`${formatCount(numWithout)} of ${formatCount(numAll)} queries have no place on the plan.`);
    if (cell > 0) {
      const size = formatLength(cell, summary, 2);
      texts.push(`Drawn: ${formatCount(numDrawn)} of ${formatCount(numAll)} queries, the least certain one in each square of ${size}; more when enlarged.`);
    }
    this.caption.textContent = texts.join(" ");
  }

  private color(query: number): string {
    return queryColor(this.mode, this.data.queries, this.data.summary, query);
  }

  private paint(): void {
    for (const [query, mark] of this.queryMarks) mark.style.color = this.color(query);
    for (const shape of this.layers.ellipses.children) (shape as SVGElement).style.color = this.color(Number(shape.getAttribute("data-of")));
  }

  setColorMode(mode: ColorMode): void {
    this.mode = mode;
    this.layers.database.setAttribute("stroke", sceneColors().database);
    this.drawQueries();
  }

  setVisible(visible: Uint8Array): void {
    this.isShown = visible;
    this.drawQueries();
  }

  private select(query: number): void {
    if (this.isDisposed) return;
    for (const mark of this.layers.queries.querySelectorAll(".plan-selected")) mark.classList.remove("plan-selected");
    this.layers.rays.replaceChildren();
    this.layers.links.replaceChildren();
    const place = query >= 0 ? marks.placeOf(this.data, this.ground, query) : null;
    if (!place) return;
    if (!this.queryMarks.has(query)) this.queryMarks.set(query, marks.queryMark(this.data, this.ground, query));
    const mark = this.queryMarks.get(query) as SVGGElement;
    mark.style.color = this.color(query);
    mark.classList.add("plan-selected");
    if (this.layers.queries.lastChild !== mark) {
      const hasFocus = document.activeElement === mark;
      this.layers.queries.append(mark); // Draws it on top, which takes the focus away.
      if (hasFocus) mark.focus();
    }
    if (hasPosition(this.data.scene, query)) void this.drawLines(query, place);
  }

  private async drawLines(query: number, from: Vec2): Promise<void> {
    const { scene } = this.data;
    const { rays, links } = sceneColors();
    const points = scene.pointIndices.subarray(scene.pointOffsets[query], scene.pointOffsets[query + 1]);
    const step = Math.max(1, points.length / MAX_NUM_RAYS);
    let d = "";
    for (let i = 0; i < points.length; i += step) d += marks.segment(from, this.ground.at(scene.points, points[Math.floor(i)]));
    this.layers.rays.replaceChildren(makeSvg("path", { class: "plan-ray", d, stroke: rays }));
    try {
      const images = await usedDatabaseImages(this.data, query);
      if (this.selection.query !== query || this.isDisposed) return;
      const lines = images.map((image) => marks.segment(from, this.ground.at(scene.databaseCentres, image)));
      const cameras = makeSvg("g", { stroke: links }, ...marks.databaseMarks(this.data, this.ground, images));
      this.layers.links.replaceChildren(makeSvg("path", { class: "plan-link", d: lines.join(""), stroke: links }), cameras);
    } catch {
      // Leaves the links out: the query page says why the details cannot be read.
    }
  }

  private fit(): void {
    const { width, height } = this.mapping;
    const { least, most } = this.box;
    const [left, top] = [24, 40]; // Borders, besides room below for the caption, in pixels
    const bottom = 30 + (this.caption.offsetHeight || 40);
    const size = (axis: 0 | 1) => Math.max(most[axis] - least[axis], 1e-3 * this.data.scene.size);
    const scale = Math.max(Math.min((width - 2 * left) / size(0), (height - top - bottom) / size(1)), 1e-9);
    [this.mapping.scale, this.fittedScale] = [scale, scale];
    const middle = (top + height - bottom) / 2;
    this.mapping.shift = [width / 2 - (scale * (least[0] + most[0])) / 2, middle + (scale * (least[1] + most[1])) / 2];
    if (this.isChanged) this.redrawLater();
    this.isChanged = false;
    this.apply();
  }

  private resize(): void {
    const [width, height] = [this.host.clientWidth || PAPER[0], this.host.clientHeight || PAPER[1]];
    if (this.isChanged && width === this.mapping.width && height === this.mapping.height) return;
    const { shift } = this.mapping;
    shift[0] += (width - this.mapping.width) / 2;
    shift[1] += (height - this.mapping.height) / 2;
    Object.assign(this.mapping, { width, height });
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    if (this.isChanged) this.apply();
    else this.fit();
  }

  private apply(): void {
    const { scale, shift } = this.mapping;
    this.world.setAttribute("transform", `matrix(${scale} 0 0 ${-scale} ${shift[0]} ${shift[1]})`);
    this.world.style.setProperty("--mark", String(this.markPixels() / scale));
    drawFrame(this.frame, this.mapping, this.ground);
    drawScale(this.scale, this.mapping, this.data.summary);
  }

  private markPixels(): number {
    const crowded = MARK_PIXELS * Math.sqrt(MAX_NUM_LARGE_MARKS / Math.max(this.queryMarks.size, 1));
    const enlarged = crowded * (this.mapping.scale / this.fittedScale);
    return Math.min(MARK_PIXELS, Math.max(MIN_MARK_PIXELS, enlarged));
  }

  // Chooses other queries soon, if not all are drawn and the plan was moved.
  private redrawLater(): void {
    if (this.numPlaced <= MAX_NUM_QUERIES) return;
    window.clearTimeout(this.redrawTimer);
    this.redrawTimer = window.setTimeout(() => this.drawQueries(), 250);
  }

  private zoom(factor: number, at: Vec2): void {
    const { shift } = this.mapping;
    this.mapping.scale *= factor;
    shift[0] = at[0] + (shift[0] - at[0]) * factor;
    shift[1] = at[1] + (shift[1] - at[1]) * factor;
    this.isChanged = true;
    this.apply();
    this.redrawLater();
  }

  private pan(x: number, y: number): void {
    this.mapping.shift[0] += x;
    this.mapping.shift[1] += y;
    this.isChanged = true;
    this.apply();
    this.redrawLater();
  }

  private markOf(target: EventTarget | null): number {
    const mark = target instanceof Element ? target.closest("[data-query]") : null;
    return mark ? Number(mark.getAttribute("data-query")) : -1;
  }

  private pickMark(query: number): boolean {
    if (query >= 0) this.selection.select(query);
    return query >= 0;
  }

  // Selects the query whose apex is at the cursor, or else the one whose mark is: marks may lie on each other.
  private click(at: Vec2, target: EventTarget | null): void {
    const { scale, shift } = this.mapping;
    let [best, least] = [this.markOf(target), APEX_PIXELS];
    for (const query of this.queryMarks.keys()) {
      const place = marks.placeOf(this.data, this.ground, query) as Vec2;
      const distance = Math.hypot(shift[0] + scale * place[0] - at[0], shift[1] - scale * place[1] - at[1]);
      if (distance < least) [best, least] = [query, distance];
    }
    this.pickMark(best);
  }

  // Moves the focus to the nearest mark in a direction; returns false if no mark has it.
  private focusNext(query: number, [dx, dy]: Vec2): boolean {
    if (query < 0) return false;
    const from = marks.placeOf(this.data, this.ground, query) as Vec2;
    let [best, least] = [-1, Infinity];
    for (const other of this.queryMarks.keys()) {
      const place = marks.placeOf(this.data, this.ground, other) as Vec2;
      const [x, y] = [place[0] - from[0], place[1] - from[1]];
      const ahead = x * dx + y * dy;
      const cost = ahead + 2 * Math.abs(x * dy - y * dx);
      if (other !== query && ahead > 0 && cost < least) [best, least] = [other, cost];
    }
    if (best < 0) return true;
    this.queryMarks.get(query)?.setAttribute("tabindex", "-1");
    this.queryMarks.get(best)?.setAttribute("tabindex", "0");
    this.queryMarks.get(best)?.focus();
    return true;
  }

  state(): ViewState {
    return {
      viewer: "plan",
      numDrawnFrustums: this.queryMarks.size + this.layers.database.childElementCount,
      numDrawnPoints: Math.min(MAX_NUM_POINTS, this.data.scene.points.length / 3),
      frameMilliseconds: 0,
      projectedQuery: (query) => this.projectedQuery(query),
    };
  }

  private projectedQuery(query: number): [number, number] {
    const place = marks.placeOf(this.data, this.ground, query);
    if (!place) return [NaN, NaN];
    const box = this.svg.getBoundingClientRect();
    const { scale, shift } = this.mapping;
    return [box.left + shift[0] + scale * place[0], box.top + shift[1] - scale * place[1]];
  }

  measure(): number {
    return 0;
  }

  dispose(): void {
    this.isDisposed = true;
    window.clearTimeout(this.redrawTimer);
    this.resizes.disconnect();
    this.host.replaceChildren();
  }
}

// Builds the plan inside `host`.
export function createPlan(host: HTMLElement, data: ViewData, selection: Selection): SceneView {
  return new PlanView(host, data, selection);
}
