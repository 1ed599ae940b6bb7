// Finds what is under the cursor: a query, a database image or a point.
import { frustumDepth } from "./frustums";
import { databasePoses, queryPoses } from "./layers";
import { vec3At, type Vec3 } from "./math";
import { distanceToLine, pickFrustum, pickPoint, type Projector } from "./picking";
import { bearingLine, hasBearing, hasPosition, type ViewData } from "./view";

export interface Found {
  query: number; // -1: none
  image: number;
}

// Returns the query or the database image that is nearest to the cursor. `isShown`: 1 a query that the filters leave.
export function findCamera(data: ViewData, projector: Projector, isShown: Uint8Array, at: [number, number]): Found {
  const query = pickFrustum(projector, queryPoses(data), frustumDepth.value, at, isShown);
  const image = pickFrustum(projector, databasePoses(data), frustumDepth.value, at);
  for (let other = 0; other < isShown.length; other++) {
    if (isShown[other] === 0 || !hasBearing(data.scene, other)) continue;
    const ends = bearingLine(data.scene, other);
    const [a, b] = [projector.project(...vec3At(ends, 0)), projector.project(...vec3At(ends, 1))];
    if (a && b) query.offer(other, Math.max(3, distanceToLine(...at, a, b)), (a[2] + b[2]) / 2);
  }
  return image.isBetterThan(query) ? { query: -1, image: image.index } : { query: query.index, image: -1 };
}

// Returns where the camera or the point under the cursor is; null if there is neither.
export function findPlace(data: ViewData, projector: Projector, isShown: Uint8Array, at: [number, number]): Vec3 | null {
  const { scene } = data;
  const { query, image } = findCamera(data, projector, isShown, at);
  if (query >= 0 && hasPosition(scene, query)) return vec3At(scene.queryCentres, query);
  if (image >= 0) return vec3At(scene.databaseCentres, image);
  const point = pickPoint(projector, scene.points, at);
  return point >= 0 ? vec3At(scene.points, point) : null;
}
