// Lets mouse, fingers and keys move the viewpoint. The mouse does what it does in COLMAP's viewer: left turns the scene about
// the point of interest, right (or Control and left) moves it, the wheel zooms towards the cursor, with Control it changes
// the size of points and with Alt that of cameras, and a double click selects.
import type { Vector3 } from "three";
import type { Viewpoint } from "./viewpoint";

export interface ControlActions {
  moved(): void;
  aim(at: [number, number]): void; // the zoom begins towards what is here
  pick(at: [number, number]): void; // pixels from the upper left corner of the canvas
  hover(at: [number, number] | null): void;
  fit(): void;
  resizePoints(factor: number): void;
  resizeCameras(factor: number): void;
}

const STEP = Math.PI / 36;
const GESTURE_MILLISECONDS = 400; // Turns of the wheel within this time belong together.

export class Controls {
  private readonly pointers = new Map<number, [number, number]>();
  private readonly ended = new AbortController();
  private isPanning = false;
  private lastWheel = -Infinity;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly viewpoint: Viewpoint,
    private readonly up: Vector3,
    private readonly actions: ControlActions,
  ) {
    const options = { signal: this.ended.signal };
    canvas.addEventListener("pointerdown", (event) => this.down(event), options);
    canvas.addEventListener("pointermove", (event) => this.move(event), options);
    canvas.addEventListener("pointerleave", () => actions.hover(null), options);
    for (const name of ["pointerup", "pointercancel"] as const) {
      canvas.addEventListener(name, (event) => this.pointers.delete(event.pointerId), options);
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault(), options);
    canvas.addEventListener("dblclick", (event) => actions.pick(this.pixels(event)), options);
    canvas.addEventListener("wheel", (event) => this.wheel(event), { ...options, passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event), options);
  }

  dispose(): void {
    this.ended.abort();
  }

  private pixels(event: MouseEvent): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  // Returns pixels as coordinates from -1 to 1, y up.
  private relative([x, y]: [number, number]): [number, number] {
    return [(2 * x) / this.canvas.clientWidth - 1, 1 - (2 * y) / this.canvas.clientHeight];
  }

  private down(event: PointerEvent): void {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.pixels(event));
    this.isPanning = event.button !== 0 || event.ctrlKey || event.metaKey;
    this.actions.hover(null);
  }

  private move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    const now = this.pixels(event);
    if (!before) return this.actions.hover(now);
    this.pointers.set(event.pointerId, now);
    if (before[0] === now[0] && before[1] === now[1]) return;
    if (this.pointers.size === 2) this.pinch(event.pointerId, before, now);
    else if (this.isPanning) this.panPixels(now[0] - before[0], now[1] - before[1]);
    else this.viewpoint.turn(this.relative(before), this.relative(now));
    this.actions.moved();
  }

  private panPixels(x: number, y: number): void {
    const half = this.canvas.clientHeight / 2;
    this.viewpoint.pan(x / half, -y / half);
  }

  // Moves and zooms by the middle and the distance of two fingers, of which one moved.
  private pinch(moved: number, before: [number, number], now: [number, number]): void {
    const other = [...this.pointers].find(([id]) => id !== moved)?.[1] ?? now;
    const length = (a: [number, number]) => Math.max(10, Math.hypot(a[0] - other[0], a[1] - other[1]));
    this.panPixels((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    const middle: [number, number] = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2];
    this.viewpoint.zoom(length(before) / length(now), ...this.relative(middle));
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? event.deltaY : event.deltaY / 33;
    const factor = Math.exp(Math.min(Math.max(lines, -8), 8) * 0.05);
    if (event.ctrlKey) return this.actions.resizePoints(1 / factor);
    if (event.altKey) return this.actions.resizeCameras(1 / factor);
    if (event.timeStamp - this.lastWheel > GESTURE_MILLISECONDS) this.actions.aim(this.pixels(event));
    this.lastWheel = event.timeStamp;
    this.viewpoint.zoom(factor, ...this.relative(this.pixels(event)));
    this.actions.moved();
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { viewpoint } = this;
    const arrows: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) viewpoint.pan(-0.1 * arrow[0], -0.1 * arrow[1]);
    else if (arrow) viewpoint.orbit(STEP * arrow[0], -STEP * arrow[1], this.up);
    else if (event.key === "+" || event.key === "=") viewpoint.zoom(1 / 1.15, 0, 0);
    else if (event.key === "-" || event.key === "_") viewpoint.zoom(1.15, 0, 0);
    else if (event.key === "Home") this.actions.fit();
    else return;
    event.preventDefault();
    this.actions.moved();
  }
}
