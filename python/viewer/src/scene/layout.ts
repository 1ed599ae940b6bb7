// Finds from where the whole scene is seen well.
import { Vector3 } from "three";
import type { Scene } from "../data";
import { dot, groundAxes, normalized, quantile, rotate, scaled, sum, vec3At, type Vec3 } from "./math";
import type { Viewpoint } from "./viewpoint";

const MAX_NUM_SAMPLES = 4000;
const ELEVATION = (32 * Math.PI) / 180;
const SIDE = (28 * Math.PI) / 180;

interface Sample {
  cameras: Vec3[];
  points: Vec3[];
}

// Returns at most MAX_NUM_SAMPLES finite vectors of a flat array, evenly spaced.
function sampleOf(values: Float32Array): Vec3[] {
  const count = values.length / 3;
  const step = Math.max(1, count / MAX_NUM_SAMPLES);
  const sample: Vec3[] = [];
  for (let i = 0; i < count; i += step) sample.push(vec3At(values, Math.floor(i)));
  return sample.filter((point) => point.every(Number.isFinite));
}

function median(points: Vec3[]): Vec3 {
  return [0, 1, 2].map((axis) => quantile(points.map((point) => point[axis]), 0.5)) as Vec3;
}

// Returns cameras and points of the scene, without those that are far away.
function takeSample(scene: Scene): Sample {
  const cameras = [...sampleOf(scene.databaseCentres), ...sampleOf(scene.queryCentres)];
  const points = sampleOf(scene.points);
  const middle = median(cameras.length > 0 ? cameras : points);
  const isNear = (point: Vec3) => Math.hypot(...sum(point, scaled(middle, -1))) <= scene.size;
  return { cameras: cameras.filter(isNear), points: points.filter(isNear) };
}

// Returns the direction in which most database cameras look, along the ground; short if they look around.
function meanDirection(scene: Scene): Vec3 {
  const count = scene.databaseRotations.length / 4;
  let mean: Vec3 = [0, 0, 0];
  for (let i = 0; i < count; i++) mean = sum(mean, scaled(rotate(scene.databaseRotations, i, [0, 0, 1]), 1 / count));
  return sum(mean, scaled(scene.up, -dot(mean, scene.up)));
}

// Returns the direction along the ground in which the cameras are least spread, and how many times longer their spread in the
// other direction is.
function shortDirection(cameras: Vec3[], up: Vec3): { direction: Vec3; elongation: number } {
  const [right, forward] = groundAxes(up);
  const middle = cameras.length > 0 ? median(cameras) : ([0, 0, 0] as Vec3);
  let [xx, xy, yy] = [0, 0, 0];
  for (const camera of cameras) {
    const x = dot(camera, right) - dot(middle, right);
    const y = dot(camera, forward) - dot(middle, forward);
    [xx, xy, yy] = [xx + x * x, xy + x * y, yy + y * y];
  }
  const angle = 0.5 * Math.atan2(2 * xy, xx - yy) + Math.PI / 2;
  const [middleSpread, difference] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  const elongation = Math.sqrt((middleSpread + difference) / Math.max(middleSpread - difference, 1e-6 * middleSpread));
  return { direction: sum(scaled(right, Math.cos(angle)), scaled(forward, Math.sin(angle))), elongation };
}

// Turns the viewpoint: from behind and above cameras that look in one direction, else from the long side of the scene. A long
// scene is always seen from its side, because from its end little of it would be seen.
export function orient(viewpoint: Viewpoint, scene: Scene): void {
  const mean = meanDirection(scene);
  const { direction, elongation } = shortDirection(takeSample(scene).cameras, scene.up);
  const isCommon = Math.hypot(...mean) > 0.4 && elongation < 4;
  const ahead = isCommon ? normalized(mean) : scaled(direction, dot(direction, mean) < 0 ? -1 : 1);
  const side = new Vector3(...ahead).applyAxisAngle(new Vector3(...scene.up), isCommon ? SIDE : 0);
  const forward = sum(scaled(side.toArray(), Math.cos(ELEVATION)), scaled(scene.up, -Math.sin(ELEVATION)));
  viewpoint.look(forward, scene.up);
}

// Returns, in the view's axes, the middle of the cameras and of nearly all points.
function middleInView(cameras: Vector3[], points: Vector3[]): Vector3 {
  const middle = (axis: "x" | "y" | "z") => {
    const ends = [0.03, 0.97].map((fraction) => quantile(points.map((point) => point[axis]), fraction));
    const all = [...cameras.map((camera) => camera[axis]), ...ends].filter(Number.isFinite);
    return all.length > 0 ? (Math.min(...all) + Math.max(...all)) / 2 : 0;
  };
  return new Vector3(middle("x"), middle("y"), middle("z"));
}

// Moves the viewpoint so that all cameras and nearly all points fill the window; it keeps looking in its direction.
export function fit(viewpoint: Viewpoint, scene: Scene): void {
  const { cameras, points } = takeSample(scene);
  const toView = viewpoint.orientation.clone().invert();
  const inView = (list: Vec3[]) => list.map((point) => new Vector3(...point).applyQuaternion(toView));
  const [viewCameras, viewPoints] = [inView(cameras), inView(points)];
  const tangent = Math.tan((viewpoint.camera.fov * Math.PI) / 360);
  const middle = middleInView(viewCameras, viewPoints);
  // Repeats because perspective shows what is near larger: the middle in space is not the middle of the window.
  for (let step = 0; step < 4; step++) {
    viewpoint.distance = neededDistance(viewCameras, viewPoints, middle, tangent, viewpoint.camera.aspect);
    viewpoint.distance += scene.frustumDepth / tangent;
    const onScreen = (point: Vector3) => {
      const { x, y, z } = point.clone().sub(middle);
      const depth = Math.max(viewpoint.distance - z, 0.05 * viewpoint.distance);
      return new Vector3(x / depth, y / depth, 0);
    };
    const shift = middleInView(viewCameras.map(onScreen), viewPoints.map(onScreen));
    middle.add(shift.setZ(0).multiplyScalar(viewpoint.distance));
  }
  viewpoint.distance = Math.max(viewpoint.distance, 0.01 * scene.size);
  viewpoint.target.copy(middle.applyQuaternion(viewpoint.orientation));
  // Turns about the middle between the usual camera and the usual point.
  const usual = [cameras, points].filter((list) => list.length > 0).map(median);
  if (usual.length > 0) viewpoint.aim(scaled(usual.reduce(sum), 1 / usual.length));
}

// Returns the distance from which all cameras and most points are inside the window.
function neededDistance(cameras: Vector3[], points: Vector3[], middle: Vector3, tangent: number, aspect: number): number {
  const needed = (point: Vector3) => {
    const { x, y, z } = point.clone().sub(middle);
    return Math.max(Math.abs(x) / (tangent * aspect), Math.abs(y) / tangent) + z;
  };
  return Math.max(...cameras.map(needed), quantile(points.map(needed), cameras.length > 0 ? 0.78 : 0.95) || 0, 0);
}

// Puts the viewpoint where a query is, so that its whole image is seen; `ahead`: distance of what it looks at.
export function lookFromQuery(viewpoint: Viewpoint, scene: Scene, query: number, ahead: number): void {
  const forward = rotate(scene.queryRotations, query, [0, 0, 1]);
  viewpoint.look(forward, rotate(scene.queryRotations, query, [0, -1, 0]));
  viewpoint.distance = ahead;
  viewpoint.target.set(...sum(vec3At(scene.queryCentres, query), scaled(forward, ahead)));
  const [left, top, right, bottom] = scene.queryExtents.subarray(4 * query, 4 * query + 4);
  const half = Math.max(-top, bottom, Math.max(-left, right) / viewpoint.camera.aspect);
  viewpoint.camera.fov = Math.min(150, (360 / Math.PI) * Math.atan(1.06 * half));
}
