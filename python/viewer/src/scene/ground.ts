// Projects the scene onto the ground, along the direction that is up for most images.
import type { Scene } from "../data";
import { dot, groundAxes, quantile, rotate, vec3At, type Vec3 } from "./math";

export type Vec2 = [number, number];
export interface Box {
  least: Vec2;
  most: Vec2;
}

// Up directions closer than this to an axis of the world count as that axis, so that the plan has the world's coordinates.
const AXIS_COSINE = 0.985;
const MAX_NUM_SAMPLES = 20000;
const AXIS_NAMES = ["x", "y", "z"];

// Describes an axis of the plan: its direction, its name, and what the world's origin adds to a coordinate.
interface Axis {
  direction: Vec3;
  name: string;
  offset: number;
  sign: number; // -1 if the world's axis runs the other way
}

export class Ground {
  readonly across: Axis;
  readonly along: Axis;

  constructor(scene: Scene) {
    const axis = scene.up.findIndex((value) => Math.abs(value) > AXIS_COSINE);
    const up = scene.up.map((value, i) => (axis < 0 ? value : i === axis ? Math.sign(value) : 0)) as Vec3;
    const [across, along] = groundAxes(up);
    this.across = makeAxis(across, scene.origin, "across");
    this.along = makeAxis(along, scene.origin, "along");
  }

  project(point: Vec3): Vec2 {
    return [dot(point, this.across.direction), dot(point, this.along.direction)];
  }

  at(values: ArrayLike<number>, index: number): Vec2 {
    return this.project(vec3At(values, index));
  }

  // Returns the absolute coordinate of a place on an axis.
  coordinate(axis: Axis, value: number): number {
    return axis.sign * (axis.offset + value);
  }

  // Returns the direction in which a camera looks, in radians from `across`; null if it looks up or down.
  heading(rotations: Float32Array, index: number): number | null {
    const [x, y] = this.project(rotate(rotations, index, [0, 0, 1]));
    return Math.hypot(x, y) < 0.2 ? null : Math.atan2(y, x);
  }

  // Returns half axes and angle of the ellipse that a covariance becomes on the ground.
  ellipse(covariance: ArrayLike<number>): { long: number; short: number; angle: number } {
    const [xx, xy, xz, yy, yz, zz] = Array.from(covariance);
    const times = (v: Vec3): Vec3 => [dot([xx, xy, xz], v), dot([xy, yy, yz], v), dot([xz, yz, zz], v)];
    const [r, f] = [this.across.direction, this.along.direction];
    const [a, b, c] = [dot(r, times(r)), dot(r, times(f)), dot(f, times(f))];
    const middle = (a + c) / 2;
    const spread = Math.hypot((a - c) / 2, b);
    const root = (value: number) => Math.sqrt(Math.max(0, value));
    return { long: root(middle + spread), short: root(middle - spread), angle: 0.5 * Math.atan2(2 * b, a - c) };
  }
}

function makeAxis(direction: Vec3, origin: Vec3, fallback: string): Axis {
  const index = direction.findIndex((value) => Math.abs(value) > 0.9999);
  const sign = index >= 0 ? Math.sign(direction[index]) : 1;
  return { direction, sign, name: index >= 0 ? AXIS_NAMES[index] : fallback, offset: dot(direction, origin) };
}

// Returns some of the finite places in a flat array of centres, evenly spaced.
function someOf(centres: Float32Array, ground: Ground): Vec2[] {
  const step = Math.max(1, Math.floor(centres.length / 3 / MAX_NUM_SAMPLES));
  const places: Vec2[] = [];
  for (let i = 0; 3 * i < centres.length; i += step) if (Number.isFinite(centres[3 * i])) places.push(ground.at(centres, i));
  return places;
}

// Returns the box around cameras and nearly all points; cameras far away from the others do not count.
export function boxOf(scene: Scene, ground: Ground): Box {
  const cameras = [...someOf(scene.databaseCentres, ground), ...someOf(scene.queryCentres, ground)];
  const points = someOf(scene.points, ground);
  const all = cameras.length > 0 ? cameras : points;
  const middle = [0, 1].map((axis) => quantile(all.map((place) => place[axis]), 0.5));
  const near = cameras.filter(([x, y]) => Math.hypot(x - middle[0], y - middle[1]) <= scene.size);
  const end = (axis: number, fraction: number, pick: (...values: number[]) => number) =>
    pick(...near.map((place) => place[axis]), ...[quantile(points.map((place) => place[axis]), fraction)].filter(Number.isFinite));
  const box: Box = { least: [end(0, 0.03, Math.min), end(1, 0.03, Math.min)], most: [end(0, 0.97, Math.max), end(1, 0.97, Math.max)] };
  return [...box.least, ...box.most].every(Number.isFinite) ? box : { least: [-1, -1], most: [1, 1] };
}

// Returns at most about `count` of the indices: one for each cell of a grid, the first one that falls into it. `smallest`: size
// of a cell that is as large as a mark.
export function thin(
  indices: number[],
  count: number,
  place: (index: number) => Vec2,
  box: Box,
  smallest = 0,
): { kept: number[]; cell: number } {
  if (indices.length <= count) return { kept: indices, cell: 0 };
  const width = Math.max(box.most[0] - box.least[0], 1e-9);
  const height = Math.max(box.most[1] - box.least[1], 1e-9);
  const cell = Math.max(Math.sqrt((width * height) / count), Math.max(width, height) / count, smallest);
  const taken = new Set<string>();
  const kept = indices.filter((index) => {
    const [x, y] = place(index);
    const key = `${Math.floor(x / cell)},${Math.floor(y / cell)}`;
    return taken.size < 2 * count && !taken.has(key) && taken.add(key);
  });
  return { kept, cell };
}
