// Shows cameras and points in three dimensions. It draws only when something changes.
import { type PerspectiveCamera, Scene as ThreeScene, Vector3, WebGLRenderer } from "three";
import { isDark, type ColorMode } from "../colors";
import { make, visibleText } from "../dom";
import type { Selection } from "../selection";
import { Controls } from "./controls";
import { LevelOfDetail } from "./detail";
import { suggestFactor } from "./ellipsoids";
import { findCamera, findPlace, type Found } from "./finding";
import { Layers } from "./layers";
import { fit, lookFromQuery, orient } from "./layout";
import { vec3At } from "./math";
import { Overlay } from "./overlay";
import { Projector } from "./picking";
import { pointDistance, SelectedQuery } from "./selected";
import { shared } from "./shaders";
import { bearingLine, describeQuery, hasBearing, hasPosition, SCENE_LOST, type SceneView, type ViewData, type ViewState } from "./view";
import { DEFAULT_FOV_DEG, Viewpoint } from "./viewpoint";
export type { SceneView } from "./view";

const REST_MILLISECONDS = 180; // After this pause a motion has ended, and everything is drawn.
const MAX_PIXEL_RATIO = 2;
const HELP = "Arrow keys turn the scene, with Shift they move it; plus and minus zoom; Home fits; the table selects.";

class WebglView implements SceneView {
  private readonly canvas = make("canvas", { class: "scene-canvas", tabindex: 0, role: "application" });
  private readonly renderer: WebGLRenderer;
  private readonly world = new ThreeScene();
  private readonly viewpoint: Viewpoint;
  private readonly layers: Layers;
  private readonly selected: SelectedQuery;
  private readonly overlay: Overlay;
  private readonly controls: Controls;
  private readonly level = new LevelOfDetail();
  private readonly resizes = new ResizeObserver(() => this.resize());
  private projector: Projector;
  private pointSize: number;
  private cameraSize = 1;
  private factor = 1;
  private frame = 0;
  private restTimer = 0;
  private isMoving = false;
  private isChoiceStale = true;
  private isFitted = false;
  private isDisposed = false;
  private hovered: [number, number] | null = null;

  constructor(
    private readonly host: HTMLElement,
    private readonly data: ViewData,
    private readonly selection: Selection,
  ) {
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, powerPreference: "high-performance" });
    this.viewpoint = new Viewpoint(data.scene.size);
    this.projector = new Projector(this.viewpoint.camera, 1, 1);
    this.layers = new Layers(data);
    this.selected = new SelectedQuery(data, this.layers, () => this.requestFrame());
    this.world.add(this.layers.root, this.selected.root);
    this.pointSize = this.usualPointSize;
    this.overlay = new Overlay(data, this.overlayActions());
    this.controls = new Controls(this.canvas, this.viewpoint, new Vector3(...data.scene.up), this.controlActions());
    this.canvas.setAttribute("aria-label", `Scene with ${data.summary.numQueries} queries. ${HELP}`);
    this.canvas.addEventListener("webglcontextlost", (event) => this.lose(event));
    host.append(this.canvas, this.overlay.element);
    selection.onChange((query) => this.select(query));
    this.resizes.observe(host);
    orient(this.viewpoint, data.scene);
    this.applyDisplay(suggestFactor(data.scene));
    this.resize();
    this.rebuild();
  }

  private get usualPointSize(): number {
    return this.data.scene.points.length > 600000 ? 1 : 2;
  }

  private overlayActions() {
    return {
      fit: () => this.fit(),
      reset: () => this.reset(),
      fromQuery: () => this.seeFromQuery(),
      setHidden: (...args: Parameters<Layers["setHidden"]>) => {
        this.layers.setHidden(...args);
        this.layers.applyHidden();
        this.requestFrame();
      },
      setFactor: (factor: number) => this.applyDisplay(factor),
      setPointSize: (pixels: number) => this.applyDisplay(this.factor, (this.pointSize = pixels)),
      setCameraSize: (factor: number) => this.applyDisplay(this.factor, this.pointSize, (this.cameraSize = factor)),
    };
  }

  private controlActions() {
    const limited = (value: number, least: number, most: number) => Math.min(Math.max(value, least), most);
    return {
      moved: () => this.move(),
      aim: (at: [number, number]) => this.aim(at),
      pick: (at: [number, number]) => this.pick(at),
      hover: (at: [number, number] | null) => this.hover(at),
      fit: () => this.fit(),
      resizePoints: (by: number) => this.applyDisplay(this.factor, (this.pointSize = limited(this.pointSize * by, 0.5, 8))),
      resizeCameras: (by: number) =>
        this.applyDisplay(this.factor, this.pointSize, (this.cameraSize = limited(this.cameraSize * by, 0.03, 30))),
    };
  }

  private applyDisplay(factor: number, pointSize = this.pointSize, cameraSize = this.cameraSize): void {
    this.factor = factor;
    this.layers.setFactor(factor);
    this.layers.points.setSize(pointSize);
    this.layers.setCameraSize(cameraSize * this.data.scene.frustumDepth);
    this.overlay.setValues(factor, pointSize, cameraSize);
    this.isChoiceStale = true;
    this.requestFrame();
  }

  setColorMode(mode: ColorMode): void {
    this.layers.setMode(mode);
    this.rebuild();
  }

  setVisible(visible: Uint8Array): void {
    this.layers.isShown = visible;
    this.rebuild();
  }

  private rebuild(): void {
    shared.darkness.value = isDark() ? 1 : 0;
    this.renderer.setClearColor(getComputedStyle(this.canvas).backgroundColor, 1);
    this.overlay.recolor();
    this.layers.rebuild();
    this.isChoiceStale = true;
    this.showSelected();
    this.requestFrame();
  }

  private showSelected(): void {
    const { query } = this.selection;
    this.layers.setSelected(query);
    this.selected.show(query);
    this.overlay.setSelected(query >= 0 && hasPosition(this.data.scene, query));
  }

  // Draws the selection, and brings it into the window if it is outside.
  private select(query: number): void {
    if (this.isDisposed) return;
    this.showSelected();
    if (query >= 0 && hasPosition(this.data.scene, query)) {
      const place = this.projector.project(...vec3At(this.data.scene.queryCentres, query));
      const { width, height } = this.projector;
      const isInside = place && place[0] > 0 && place[1] > 0 && place[0] < width && place[1] < height;
      if (!isInside) this.viewpoint.target.set(...vec3At(this.data.scene.queryCentres, query));
    }
    this.move();
  }

  private fit(): void {
    this.viewpoint.camera.fov = DEFAULT_FOV_DEG;
    fit(this.viewpoint, this.data.scene);
    this.move();
  }

  private reset(): void {
    orient(this.viewpoint, this.data.scene);
    [this.pointSize, this.cameraSize] = [this.usualPointSize, 1];
    this.applyDisplay(suggestFactor(this.data.scene));
    this.fit();
  }

  private seeFromQuery(): void {
    const { query } = this.selection;
    if (query < 0 || !hasPosition(this.data.scene, query)) return;
    lookFromQuery(this.viewpoint, this.data.scene, query, pointDistance(this.data, query));
    this.move();
  }

  private resize(): void {
    const [width, height] = [this.host.clientWidth, this.host.clientHeight];
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, MAX_PIXEL_RATIO));
    this.renderer.setSize(width, height, false);
    this.viewpoint.update(width, height);
    if (!this.isFitted) fit(this.viewpoint, this.data.scene);
    this.isFitted = true;
    this.isChoiceStale = true;
    this.requestFrame();
  }

  // Draws frame after frame while the viewpoint moves, so that their times can be measured, and once more at the end.
  private move(): void {
    this.isMoving = true;
    this.isChoiceStale = true;
    window.clearTimeout(this.restTimer);
    this.restTimer = window.setTimeout(() => {
      this.isMoving = false;
      this.level.rest();
      this.requestFrame();
    }, REST_MILLISECONDS);
    this.requestFrame();
  }

  private requestFrame(): void {
    if (this.frame === 0 && !this.isDisposed) this.frame = requestAnimationFrame((now) => this.drawFrame(now));
  }

  private drawFrame(now: number): void {
    this.frame = 0;
    if (this.isMoving) this.level.frame(now);
    if (this.isMoving) {
      this.draw(this.level.detail, this.level.isCoarse);
      this.requestFrame();
      return;
    }
    this.level.complete(this.timeFrame(1, false));
    if (this.hovered) this.hover(this.hovered);
  }

  // Draws a frame and returns the milliseconds until the graphics card has finished it.
  private timeFrame(detail: number, isCoarse: boolean): number {
    const gl = this.renderer.getContext();
    const wait = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    wait(); // Lets the graphics card finish earlier frames.
    const start = performance.now();
    this.draw(detail, isCoarse);
    wait();
    return performance.now() - start;
  }

  private draw(detail: number, isCoarse: boolean): void {
    const [width, height] = [this.host.clientWidth, this.host.clientHeight];
    if (width === 0 || height === 0) return;
    const camera = this.updateProjector();
    if (this.isChoiceStale && !this.isMoving) {
      this.layers.choose(this.projector);
      this.isChoiceStale = false;
    }
    this.layers.setDetail(detail, isCoarse);
    const ratio = this.renderer.getPixelRatio();
    shared.viewport.value.set(width * ratio, height * ratio);
    shared.pixelRatio.value = ratio;
    this.renderer.render(this.world, camera);
    this.placeLabel();
  }

  private updateProjector(): PerspectiveCamera {
    const [width, height] = [this.host.clientWidth, this.host.clientHeight];
    const camera = this.viewpoint.update(width, height);
    this.projector = new Projector(camera, width, height);
    return camera;
  }

  private placeLabel(): void {
    const { query } = this.selection;
    const place = query >= 0 ? this.projectQuery(query) : null;
    const isSeenFrom = place !== null && place[2] < 0.01 * this.viewpoint.distance;
    const text = query >= 0 ? visibleText(this.data.queries.names[query]) : "";
    this.overlay.setLabel(text, place && !isSeenFrom ? [place[0], place[1]] : null);
  }

  // Returns pixels of a query's apex, or of the middle of its bearing line; null if it is not in view.
  private projectQuery(query: number): [number, number, number] | null {
    const { scene } = this.data;
    if (hasPosition(scene, query)) return this.projector.project(...vec3At(scene.queryCentres, query));
    if (!hasBearing(scene, query)) return null;
    const [x, y, z, x2, y2, z2] = bearingLine(scene, query);
    return this.projector.project((x + x2) / 2, (y + y2) / 2, (z + z2) / 2);
  }

  private find(at: [number, number]): Found {
    return findCamera(this.data, this.projector, this.layers.isShown, at);
  }

  private aim(at: [number, number]): void {
    this.updateProjector();
    const place = findPlace(this.data, this.projector, this.layers.isShown, at);
    if (place) this.viewpoint.aim(place);
  }

  // Selects the query under the cursor, or turns about what is there from now on, or selects nothing.
  private pick(at: [number, number]): void {
    const { query } = this.find(at);
    if (query >= 0) return this.selection.select(query);
    const place = findPlace(this.data, this.projector, this.layers.isShown, at);
    if (!place) return this.selection.select(-1);
    const goal = new Vector3(...place);
    this.viewpoint.distance = goal.distanceTo(this.viewpoint.eye);
    this.viewpoint.target.copy(goal);
    this.move();
  }

  private hover(at: [number, number] | null): void {
    this.hovered = at;
    if (this.isMoving || !at) return this.overlay.setTooltip("", null);
    const { query, image } = this.find(at);
    const text = query >= 0 ? describeQuery(this.data, query) : image >= 0 ? this.data.scene.databaseNames[image] : "";
    this.overlay.setTooltip(text, text ? at : null);
    this.canvas.style.cursor = query >= 0 ? "pointer" : "";
  }

  private lose(event: Event): void {
    event.preventDefault();
    if (this.isDisposed) return;
    const text = "The graphics card is no longer available; the plan is shown instead.";
    this.host.append(make("p", { class: "scene-message", role: "alert" }, text));
    this.host.dispatchEvent(new CustomEvent(SCENE_LOST, { bubbles: true }));
  }

  state(): ViewState {
    return {
      viewer: "webgl",
      numDrawnFrustums: this.layers.numFrustums,
      numDrawnPoints: this.layers.points.object.visible ? this.layers.points.numDrawn : 0,
      frameMilliseconds: this.level.milliseconds,
      projectedQuery: (query) => {
        this.updateProjector(); // The viewpoint may have moved since the last frame.
        const place = this.projectQuery(query);
        const box = this.canvas.getBoundingClientRect();
        return place ? [place[0] + box.left, place[1] + box.top] : [NaN, NaN];
      },
    };
  }

  measure(isCoarse: boolean): number {
    const milliseconds = this.timeFrame(isCoarse ? this.level.detail : 1, isCoarse);
    this.requestFrame();
    return milliseconds;
  }

  dispose(): void {
    this.isDisposed = true;
    cancelAnimationFrame(this.frame);
    window.clearTimeout(this.restTimer);
    this.resizes.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
    if (!this.renderer.getContext().isContextLost()) this.renderer.forceContextLoss();
    this.host.replaceChildren();
  }
}

// Builds the scene inside `host`; throws if the browser has no WebGL.
export function createScene(host: HTMLElement, data: ViewData, selection: Selection): SceneView {
  return new WebglView(host, data, selection);
}
