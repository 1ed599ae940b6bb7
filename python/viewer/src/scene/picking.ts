// Finds the frustum nearest to the cursor, in pixels.
import type { Matrix4, PerspectiveCamera } from "three";
import type { Poses } from "./frustums";
import { rotate, type Vec3 } from "./math";

const REACH = 12; // pixels
const MAX_NUM_POINTS_TRIED = 300000;
const NEAR_APEX = 4; // pixels: so near an apex the cursor means it, whatever edges pass there

// Projects points of the world to pixels of the window.
export class Projector {
  private readonly m: number[];

  constructor(
    camera: PerspectiveCamera,
    readonly width: number,
    readonly height: number,
  ) {
    const matrix: Matrix4 = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse);
    this.m = matrix.elements;
  }

  // Returns pixels and the distance along the view; null behind the viewer.
  project(x: number, y: number, z: number): Vec3 | null {
    const { m } = this;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (!(w > 0)) return null;
    const u = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w;
    const v = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
    return [0.5 * (u + 1) * this.width, 0.5 * (1 - v) * this.height, w];
  }

  // Returns the distance along the view to a place in the window, or less than a window beside it; else infinity.
  distanceIfNear(x: number, y: number, z: number): number {
    const { m } = this;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (!(w > 0)) return Infinity;
    const u = m[0] * x + m[4] * y + m[8] * z + m[12];
    const v = m[1] * x + m[5] * y + m[9] * z + m[13];
    return Math.abs(u) < 3 * w && Math.abs(v) < 3 * w ? w : Infinity;
  }

  // Returns how many pixels a length has at a distance along the view.
  pixels(length: number, distance: number): number {
    return (length * 0.5 * this.height * Math.hypot(this.m[1], this.m[5], this.m[9])) / distance;
  }
}

// Returns the distance from a point to the line between two points.
export function distanceToLine(x: number, y: number, a: ArrayLike<number>, b: ArrayLike<number>): number {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const square = dx * dx + dy * dy;
  const t = square > 0 ? Math.min(1, Math.max(0, ((x - a[0]) * dx + (y - a[1]) * dy) / square)) : 0;
  return Math.hypot(x - a[0] - t * dx, y - a[1] - t * dy);
}

// Remembers the best candidate so far: the smallest distance, and of equal ones that in front.
export class Nearest {
  index = -1;
  private cost = REACH;
  private depth = Infinity;

  offer(index: number, cost: number, depth: number): void {
    if (cost > this.cost || (cost === this.cost && depth >= this.depth)) return;
    [this.index, this.cost, this.depth] = [index, cost, depth];
  }

  isBetterThan(other: Nearest): boolean {
    return this.index >= 0 && (this.cost < other.cost || (this.cost === other.cost && this.depth < other.depth));
  }
}

// Returns the corners of a frustum's image plane.
function cornersOf(poses: Poses, index: number, depth: number): Vec3[] {
  const [left, top, right, bottom] = poses.extents.subarray(4 * index, 4 * index + 4);
  const corners: [number, number][] = [[left, top], [right, top], [right, bottom], [left, bottom]];
  return corners.map(([x, y]) => {
    const [px, py, pz] = rotate(poses.rotations, index, [x * depth, y * depth, depth]);
    return [px + poses.centres[3 * index], py + poses.centres[3 * index + 1], pz + poses.centres[3 * index + 2]];
  });
}

// Returns the distance of the cursor to the edges of a frustum; those closer than 3 pixels count as equal.
function distanceToEdges(projector: Projector, poses: Poses, index: number, depth: number, apex: Vec3, at: [number, number]) {
  const corners = cornersOf(poses, index, depth).map((corner) => projector.project(...corner));
  let least = Infinity;
  corners.forEach((corner, i) => {
    const next = corners[(i + 1) % 4];
    if (!corner || !next) return;
    least = Math.min(least, distanceToLine(...at, apex, corner), distanceToLine(...at, corner, next));
  });
  return Math.max(3, least);
}

// Returns the frustum under the cursor. `isShown`: 1 for those that can be picked; `depth`: that of the frustums.
export function pickFrustum(projector: Projector, poses: Poses, depth: number, at: [number, number], isShown?: Uint8Array): Nearest {
  const nearest = new Nearest();
  const { centres, extents } = poses;
  for (let i = 0; 3 * i < centres.length; i++) {
    if (isShown && isShown[i] === 0) continue;
    const apex = projector.project(centres[3 * i], centres[3 * i + 1], centres[3 * i + 2]);
    if (!apex) continue;
    const distance = Math.hypot(apex[0] - at[0], apex[1] - at[1]);
    if (distance < NEAR_APEX) nearest.offer(i, Math.floor(distance) / 2, apex[2]);
    const widest = Math.max(-extents[4 * i], -extents[4 * i + 1], extents[4 * i + 2], extents[4 * i + 3]);
    const isNearViewer = apex[2] < 3 * depth * (1 + widest);
    if (!isNearViewer && distance > 2 * projector.pixels(depth * (1 + 1.5 * widest), apex[2]) + REACH) continue;
    nearest.offer(i, distanceToEdges(projector, poses, i, depth, apex, at), apex[2]);
  }
  return nearest;
}

// Returns the index of the point under the cursor, the one in front if there are several; -1 if there is none. Looks at every
// n-th point only if there are many, because neighbours are as good.
export function pickPoint(projector: Projector, points: Float32Array, at: [number, number]): number {
  const step = Math.ceil(points.length / 3 / MAX_NUM_POINTS_TRIED) || 1;
  let [best, depth] = [-1, Infinity];
  for (let i = 0; 3 * i < points.length; i += step) {
    const place = projector.project(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    if (place && place[2] < depth && Math.hypot(place[0] - at[0], place[1] - at[1]) < 5) [best, depth] = [i, place[2]];
  }
  return best;
}
