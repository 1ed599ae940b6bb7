// Lays buttons, a legend with switches, a tooltip and the name of the selected query over the scene.
import { sceneColors, statusColor } from "../colors";
import { button, make } from "../dom";
import { MAX_FACTOR } from "./ellipsoids";
import type { LayerName } from "./layers";
import { hasBearing, hasPosition, type ViewData } from "./view";

export interface OverlayActions {
  fit(): void;
  reset(): void;
  fromQuery(): void;
  setHidden(layer: LayerName, isHidden: boolean): void;
  setFactor(factor: number): void;
  setPointSize(pixels: number): void;
  setCameraSize(factor: number): void;
}

type Swatch = "frustum" | "dashed" | "line" | "dash" | "dots" | "ball";

const queriesOf = ({ scene, queries }: ViewData, has: (query: number) => boolean) =>
  scene ? queries.names.reduce((count, _, query) => count + Number(has(query)), 0) : 0;

export class Overlay {
  readonly element = make("div", { class: "scene-overlay" });
  private readonly tooltip = make("div", { class: "scene-tooltip", hidden: true });
  private readonly label = make("div", { class: "scene-label", hidden: true });
  private readonly eye: HTMLButtonElement;
  private readonly factorText = make("span");
  private readonly factor = make("input", { type: "range", min: 0, max: 3, step: 0.01 });
  private readonly pointSize = make("input", { type: "range", min: 0.5, max: 8, step: 0.5 });
  private readonly swatches: { element: HTMLElement; color: () => string }[] = [];
  private readonly cameraSize = make("input", { type: "range", min: -1.5, max: 1.5, step: 0.05 });

  constructor(
    private readonly data: ViewData,
    private readonly actions: OverlayActions,
  ) {
    this.eye = button("From the query\u2019s eye", () => actions.fromQuery(), { disabled: true });
    const bar = make("div", { class: "scene-buttons", role: "group", "aria-label": "Viewpoint" });
    bar.append(button("Fit", () => actions.fit()), this.eye, button("Reset", () => actions.reset()));
    this.element.append(this.label, this.tooltip, bar, this.legend());
  }

  private legend(): HTMLElement {
    const { scene } = this.data;
    const legend = make("details", { class: "scene-legend" }, make("summary", {}, "Legend and display"));
    if (!window.matchMedia("(max-width: 600px)").matches) legend.open = true;
    const add = (has: boolean, ...parts: Parameters<Overlay["layer"]>) => has && legend.append(this.layer(...parts));
    add(scene.databaseNames.length > 0, "database", "frustum", () => sceneColors().database, "Database images");
    add(scene.points.length > 0, "points", "dots", () => sceneColors().database, "Points");
    const numPlaced = queriesOf(this.data, (query) => hasPosition(scene, query));
    add(numPlaced > 0, "ellipsoids", "ball", () => "currentColor", this.factorText);
    add(scene.trueCentres.length > 0, "truth", "dashed", () => sceneColors().truth, "True position, error line");
    add(queriesOf(this.data, (query) => hasBearing(scene, query)) > 0, "bearings", "dash", () => statusColor("SCALE_UNOBSERVABLE"), "Bearing without distance");
    add(scene.changes.length > 0, "changes", "line", () => sceneColors().changes, "Moved, vanished or new");
    add(scene.shifts.length > 0, "shifts", "line", () => sceneColors().links, `Moved by joint adjustment \u00d7 ${scene.shiftFactor}`);
    const residuals = `Residuals \u00d7 ${scene.controlFactor} of control points in`;
    const hasNew = scene.controlIsNew.includes(1);
    add(hasNew, "control", "line", () => sceneColors().control, `${residuals} new photos`);
    if (scene.controlIsNew.includes(0)) {
      const row = [() => sceneColors().selected, `${residuals} database images`] as const;
      legend.append(hasNew ? this.fixed(...row) : this.layer("control", "line", ...row));
    }
    const overlaps = scene.overlapDatabase.length + scene.overlapQueries.length > 0;
    add(overlaps, "overlap", "line", () => sceneColors().database, "Common matches with database images", false);
    if (overlaps) legend.append(this.fixed(() => sceneColors().rays, "Common matches of new photos"));
    const numConnections = scene.queryConnections.length + scene.databaseConnections.length;
    add(numConnections > 0, "connections", "line", () => sceneColors().selected, "Rig or trajectory");
    legend.append(this.fixed(() => sceneColors().rays, "Selected query to its points"));
    legend.append(this.fixed(() => sceneColors().links, "Selected query to images it used"));
    legend.append(make("details", {}, make("summary", {}, "Sizes"), ...this.sliders(numPlaced > 0)));
    return legend;
  }

  // Returns a line of the legend without a switch.
  private fixed(color: () => string, text: string): HTMLElement {
    return make("div", { class: "scene-row scene-fixed" }, this.swatch("line", color), text);
  }

  private swatch(kind: Swatch, color: () => string): HTMLElement {
    const element = make("span", { class: `scene-swatch scene-${kind}`, "aria-hidden": "true" });
    this.swatches.push({ element, color });
    return element;
  }

  // Gives the legend the colours of light or dark mode.
  recolor(): void {
    for (const { element, color } of this.swatches) element.style.color = color();
  }

  private layer(name: LayerName, kind: Swatch, color: () => string, text: string | HTMLElement, isOn = true): HTMLElement {
    const box = make("input", { type: "checkbox", change: () => this.actions.setHidden(name, !box.checked) });
    box.checked = isOn;
    return make("label", { class: "scene-row" }, box, this.swatch(kind, color), text);
  }

  private sliders(hasEllipsoids: boolean): HTMLElement[] {
    const slider = (input: HTMLInputElement, text: string, apply: (value: number) => void) => {
      input.addEventListener("input", () => apply(Number(input.value)));
      return make("label", { class: "scene-row" }, make("span", { class: "scene-name" }, text), input);
    };
    const rows = [
      slider(this.pointSize, "Point size", (value) => this.actions.setPointSize(value)),
      slider(this.cameraSize, "Camera size", (value) => this.actions.setCameraSize(10 ** value)),
    ];
    if (hasEllipsoids) rows.unshift(slider(this.factor, "Ellipsoids", (value) => this.actions.setFactor(10 ** value)));
    return rows;
  }

  // Shows the values that are in use; `factor`: by which the ellipsoids are enlarged.
  setValues(factor: number, pointSize: number, cameraSize: number): void {
    const rounded = Number(factor.toPrecision(2));
    this.factorText.textContent = `Uncertainty: 3 std. dev. \u00d7 ${Math.min(rounded, MAX_FACTOR)}`;
    this.factor.value = String(Math.log10(factor));
    this.factor.setAttribute("aria-valuetext", `times ${rounded}`);
    this.pointSize.value = String(pointSize);
    this.cameraSize.value = String(Math.log10(cameraSize));
  }

  setSelected(canSeeFromIt: boolean): void {
    this.eye.disabled = !canSeeFromIt;
  }

  private place(element: HTMLElement, text: string, at: [number, number] | null): void {
    element.hidden = at === null;
    if (!at) return;
    if (element.textContent !== text) element.textContent = text;
    const [width, height] = [this.element.clientWidth, this.element.clientHeight];
    const left = Math.min(at[0] + 12, width - element.offsetWidth - 4);
    const top = Math.min(Math.max(4, at[1] - element.offsetHeight - 8), height - element.offsetHeight - 4);
    element.style.transform = `translate(${Math.max(4, left)}px, ${top}px)`;
  }

  // Shows a text at the cursor; null hides it.
  setTooltip(text: string, at: [number, number] | null): void {
    this.place(this.tooltip, text, at);
  }

  // Names the selected query beside its frustum; null hides the name.
  setLabel(text: string, at: [number, number] | null): void {
    const isOutside = at !== null && (at[0] < 0 || at[1] < 0 || at[0] > this.element.clientWidth || at[1] > this.element.clientHeight);
    this.place(this.label, text, isOutside ? null : at);
  }
}
