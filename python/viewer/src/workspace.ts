// Holds the panel with the scene: switches between the scene in space and its plan, and explains the colours.
import { type ColorMode, legend } from "./colors";
import { button, make } from "./dom";
import { createPlan } from "./plan";
import { createScene } from "./scene/scene";
import { SCENE_LOST, type SceneView, type ViewData } from "./scene/view";
import type { Selection } from "./selection";

const MODES: [mode: ColorMode, label: string][] = [
  ["status", "status"],
  ["confidence", "confidence"],
  ["error", "position error"],
];

// Asks before three.js does, because three.js writes an error to the console.
function hasWebGl(): boolean {
  return document.createElement("canvas").getContext("webgl2") !== null;
}

export class ScenePanel {
  readonly element: HTMLElement;
  view: SceneView | null = null;
  private mode: ColorMode = "status";
  private visible: Uint8Array | null = null;
  private readonly host = make("div", { class: "scene-host" });
  private readonly printHost = make("div", { class: "print-host", "aria-hidden": "true" });
  private printView: SceneView | null = null;
  private readonly key = make("ul", { class: "legend" });
  private readonly message = make("p", { class: "muted message", hidden: true });
  private readonly switches: Record<"webgl" | "plan", HTMLButtonElement>;

  constructor(
    private readonly data: ViewData,
    private readonly selection: Selection,
  ) {
    this.switches = {
      webgl: button("3D", () => this.open("webgl"), { title: "Scene in space" }),
      plan: button("Plan", () => this.open("plan"), { title: "Seen from above" }),
    };
    const views = make(
      "div",
      { class: "switch", role: "group", "aria-label": "View" },
      this.switches.webgl,
      this.switches.plan,
    );
    const bar = make("div", { class: "bar" }, views, this.modeField(), this.key);
    this.element = make(
      "section",
      { class: "panel scene-panel", "aria-label": "Scene" },
      bar,
      this.message,
      this.host,
      this.printHost,
    );
    this.element.addEventListener(SCENE_LOST, () =>
      this.giveUpScene("The graphics card is no longer available, so here is the plan."),
    );
    window.addEventListener("beforeprint", () => this.showPrint());
    window.addEventListener("afterprint", () => this.hidePrint());
    this.showLegend();
  }

  // Opens a view; falls back to the plan where WebGL does not work.
  open(viewer: "webgl" | "plan"): void {
    this.view?.dispose();
    this.host.replaceChildren();
    this.message.hidden = true;
    this.view = viewer === "webgl" ? this.openScene() : createPlan(this.host, this.data, this.selection);
    this.view.setColorMode(this.mode);
    if (this.visible) this.view.setVisible(this.visible);
    const opened = this.view.state().viewer;
    for (const [name, element] of Object.entries(this.switches))
      element.setAttribute("aria-pressed", String(name === opened));
  }

  setVisible(visible: Uint8Array): void {
    this.visible = visible;
    this.view?.setVisible(visible);
  }

  // Draws again with the colours of light or dark mode.
  refresh(): void {
    this.view?.setColorMode(this.mode);
    this.showLegend();
  }

  private openScene(): SceneView {
    try {
      if (hasWebGl()) return createScene(this.host, this.data, this.selection);
    } catch {
      this.host.replaceChildren();
    }
    this.explain("This browser shows no 3D graphics (WebGL), so here is the plan.");
    this.switches.webgl.disabled = true;
    return createPlan(this.host, this.data, this.selection);
  }

  private giveUpScene(reason: string): void {
    this.open("plan");
    this.explain(reason);
  }

  private explain(text: string): void {
    this.message.hidden = false;
    this.message.textContent = text;
  }

  private modeField(): HTMLElement {
    const modes = MODES.filter(([mode]) => mode !== "error" || this.data.summary.hasTruth);
    const options = modes.map(([mode, label]) => make("option", { value: mode }, label));
    const field = make("select", { class: "field" }, ...options);
    field.addEventListener("change", () => {
      this.mode = field.value as ColorMode;
      this.refresh();
    });
    return make("label", {}, "Colour by ", field);
  }

  private showLegend(): void {
    const entries = legend(this.mode, this.data.queries, this.data.summary).map(({ color, label, hollow }) => {
      const swatch = make("span", { class: hollow ? "swatch hollow" : "swatch" });
      swatch.style.color = color;
      return make("li", {}, swatch, label);
    });
    this.key.replaceChildren(...entries);
  }

  private showPrint(): void {
    this.hidePrint();
    this.printView = createPlan(this.printHost, this.data, this.selection);
    this.printView.setColorMode(this.mode);
    if (this.visible) this.printView.setVisible(this.visible);
  }

  private hidePrint(): void {
    this.printView?.dispose();
    this.printView = null;
    this.printHost.replaceChildren();
  }
}
