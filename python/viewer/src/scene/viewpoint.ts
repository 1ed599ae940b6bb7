// Holds from where the scene is seen: a camera that turns about a point of interest.
import { Matrix4, PerspectiveCamera, Quaternion, Vector3 } from "three";
import type { Vec3 } from "./math";

export const DEFAULT_FOV_DEG = 45;

// Returns where a point of the window touches Shoemake's arcball; x and y run from -1 to 1, y up.
function onArcball(x: number, y: number): Vector3 {
  const square = x * x + y * y;
  return square <= 1 ? new Vector3(x, y, Math.sqrt(1 - square)) : new Vector3(x, y, 0).normalize();
}

export class Viewpoint {
  readonly target = new Vector3();
  readonly orientation = new Quaternion(); // world from view; the view looks along -z
  readonly camera = new PerspectiveCamera(DEFAULT_FOV_DEG, 1, 0.1, 1000);
  distance = 1;

  // `size`: diagonal of the scene without outliers, from which the clipping planes follow.
  constructor(private readonly size: number) {}

  get eye(): Vector3 {
    return new Vector3(0, 0, this.distance).applyQuaternion(this.orientation).add(this.target);
  }

  // Returns half the height that is seen at the distance of the point of interest.
  private get halfHeight(): number {
    return this.distance * Math.tan((this.camera.fov * Math.PI) / 360);
  }

  // Turns the scene like COLMAP's viewer: the point under the cursor moves on a ball around the point of interest.
  turn(from: [number, number], to: [number, number]): void {
    const start = onArcball(...from);
    const end = onArcball(...to);
    const angle = 2 * Math.acos(Math.min(1, start.dot(end)));
    const axis = end.cross(start);
    if (angle < 1e-4 || axis.lengthSq() === 0) return;
    this.orientation.multiply(new Quaternion().setFromAxisAngle(axis.normalize(), angle)).normalize();
  }

  // Turns about the vertical of the scene and about the horizontal of the window, in radians.
  orbit(horizontal: number, vertical: number, up: Vector3): void {
    this.orientation.premultiply(new Quaternion().setFromAxisAngle(up, horizontal));
    this.orientation.multiply(new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), vertical)).normalize();
  }

  // Moves the scene along with the cursor; in parts of half the window's height.
  pan(right: number, up: number): void {
    const move = new Vector3(-right, -up, 0).multiplyScalar(this.halfHeight);
    this.target.add(move.applyQuaternion(this.orientation));
  }

  // Multiplies the distance by `factor` so that the point under the cursor (from -1 to 1, y up) stays there.
  zoom(factor: number, x: number, y: number): void {
    const shift = new Vector3(x * this.camera.aspect, y, 0).multiplyScalar(this.halfHeight * (1 - factor));
    const least = 1e-3 * this.size;
    if (this.distance * factor < least) shift.z = -this.distance * (1 - factor); // Goes on, past the point of interest.
    this.target.add(shift.applyQuaternion(this.orientation));
    this.distance = Math.min(Math.max(this.distance * factor, least), 20 * this.size);
  }

  // Moves the point of interest along the view, so that zooming leads to what is as far away as `place`; the picture stays.
  aim(place: Vec3): void {
    const { eye } = this;
    const forward = new Vector3(0, 0, -1).applyQuaternion(this.orientation);
    const depth = new Vector3(...place).sub(eye).dot(forward);
    if (depth < 1e-4 * this.size) return;
    this.distance = depth;
    this.target.copy(eye).addScaledVector(forward, depth);
  }

  // Looks along `forward` with `up` upward in the window.
  look(forward: Vec3, up: Vec3): void {
    const back = new Vector3(...forward).negate();
    this.orientation.setFromRotationMatrix(new Matrix4().lookAt(back, new Vector3(), new Vector3(...up)));
  }

  // Brings three's camera up to date. The clipping planes depend on the scene's size rather than on its farthest camera,
  // because a failed query may be anywhere.
  update(width: number, height: number): PerspectiveCamera {
    const { camera } = this;
    camera.aspect = width / Math.max(1, height);
    camera.far = this.distance + this.eye.length() + 20 * this.size;
    camera.near = Math.max(0.005 * this.distance, 1e-5 * camera.far);
    camera.position.copy(this.eye);
    camera.quaternion.copy(this.orientation);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    return camera;
  }
}
