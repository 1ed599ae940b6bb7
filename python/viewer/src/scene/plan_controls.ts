// Lets mouse and keys move the plan: dragging moves it, the wheel zooms towards the cursor, a click selects.
import type { Vec2 } from "./ground";

export interface PlanActions {
  zoom(factor: number, at: Vec2): void; // picture's pixels
  pan(x: number, y: number): void;
  fit(): void;
  click(at: Vec2, target: EventTarget | null): void;
  focusNext(from: EventTarget | null, direction: Vec2): boolean; // False if no mark has the focus
  press(target: EventTarget | null): boolean; // False if there is no mark to select
}

const ARROWS: Record<string, Vec2> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class PlanControls {
  private dragged: { from: Vec2; last: Vec2; isFar: boolean } | null = null;
  private wasDragged = false;

  constructor(
    private readonly svg: SVGSVGElement,
    private readonly actions: PlanActions,
  ) {
    svg.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    svg.addEventListener("pointerdown", (event) => {
      const at: Vec2 = [event.clientX, event.clientY];
      this.dragged = { from: at, last: at, isFar: false };
    });
    svg.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"] as const) svg.addEventListener(name, () => this.drop());
    svg.addEventListener("click", (event) => {
      if (!this.wasDragged) actions.click(this.pixels(event), event.target);
    });
    svg.addEventListener("keydown", (event) => this.key(event));
  }

  private pixels(event: MouseEvent): Vec2 {
    const box = this.svg.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? event.deltaY : event.deltaY / 33;
    this.actions.zoom(Math.exp(-0.05 * Math.min(Math.max(lines, -8), 8)), this.pixels(event));
  }

  private drag(event: PointerEvent): void {
    const { dragged } = this;
    if (!dragged || event.buttons === 0) return;
    const { from, last } = dragged;
    dragged.isFar ||= Math.hypot(event.clientX - from[0], event.clientY - from[1]) > 4;
    if (!dragged.isFar) return;
    this.svg.setPointerCapture(event.pointerId);
    this.actions.pan(event.clientX - last[0], event.clientY - last[1]);
    dragged.last = [event.clientX, event.clientY];
  }

  private drop(): void {
    this.wasDragged = this.dragged?.isFar ?? false; // Ignores the click that ends a motion.
    this.dragged = null;
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    const middle: Vec2 = [this.svg.clientWidth / 2, this.svg.clientHeight / 2];
    if (arrow) {
      if (!this.actions.focusNext(event.target, arrow)) this.actions.pan(-60 * arrow[0], 60 * arrow[1]);
    } else if (event.key === "Enter" || event.key === " ") {
      if (!this.actions.press(event.target)) return;
    } else if (event.key === "+" || event.key === "=") this.actions.zoom(1.2, middle);
    else if (event.key === "-" || event.key === "_") this.actions.zoom(1 / 1.2, middle);
    else if (event.key === "Home") this.actions.fit();
    else return;
    event.preventDefault();
  }
}
