// Holds what the scene always shows: points, database images, queries with their uncertainties, truth, lines.
import { Group, type Object3D } from "three";
import { queryColor, sceneColors, type ColorMode } from "../colors";
import { Ellipsoids, NUM_STANDARD_DEVIATIONS } from "./ellipsoids";
import { frustumDepth, Frustums, LOOKS, type Poses } from "./frustums";
import { Lines } from "./lines";
import { vec3At } from "./math";
import type { Projector } from "./picking";
import { PointCloud } from "./points";
import { colorBytes } from "./shaders";
import { bearingLine, hasBearing, hasPosition, hasTruth, type ViewData } from "./view";

// More frustums than this are not drawn at once; the other cameras become points.
const MAX_NUM_FRUSTUMS = 12000;
const MAX_NUM_ELLIPSOIDS = 2000;
const MAX_NUM_COARSE_LINES = 3000;
// Smaller ones do not tell more than a dot.
const SMALL_FRUSTUM_PIXELS = 5;
const SMALL_ELLIPSOID_PIXELS = 3;

export type LayerName = "points" | "database" | "ellipsoids" | "truth" | "bearings" | "connections" | "changes" | "shifts" | "control" | "overlap";

export function queryPoses({ scene }: ViewData): Poses {
  return { centres: scene.queryCentres, rotations: scene.queryRotations, extents: scene.queryExtents };
}

export function databasePoses({ scene }: ViewData): Poses {
  return { centres: scene.databaseCentres, rotations: scene.databaseRotations, extents: scene.databaseExtents };
}

// Returns a colour for each of `count` frustums that are drawn alike.
export function repeated(css: string, count: number): Uint8Array {
  const tint = [...colorBytes(css), LOOKS.filled];
  return new Uint8Array(4 * count).map((_, i) => tint[i % 4]);
}

// Returns the ends of lines between pairs of cameras, those of which both have a position.
function linesBetween(pairs: Uint32Array, centres: Float32Array, isShown: (index: number) => boolean): number[] {
  return linesToOthers(pairs, centres, centres, isShown, isShown);
}

function linesToOthers(
  pairs: Uint32Array,
  centres: Float32Array,
  otherCentres: Float32Array,
  isShown: (index: number) => boolean,
  isOtherShown: (index: number) => boolean,
): number[] {
  const ends: number[] = [];
  for (let i = 0; i < pairs.length; i += 2) {
    const [a, b] = [pairs[i], pairs[i + 1]];
    if (isShown(a) && isOtherShown(b)) ends.push(...vec3At(centres, a), ...vec3At(otherCentres, b));
  }
  return ends;
}

export class Layers {
  readonly root = new Group();
  readonly points: PointCloud;
  isShown: Uint8Array; // 1 a query that the filters leave
  private readonly database: Frustums;
  private readonly queries = new Frustums({ width: 1.6, fill: 0.3 });
  private readonly truth = new Frustums({ width: 1.3, isDashed: true });
  private readonly ellipsoids = new Ellipsoids();
  private readonly errors = new Lines({ width: 1.2 });
  private readonly bearings = new Lines({ width: 1.6, isDashed: true });
  private readonly connections = new Lines({ width: 1, opacity: 0.7 });
  private readonly databaseConnections = new Lines({ width: 1, opacity: 0.5 });
  private readonly changes = new Lines({ width: 2 });
  private readonly shifts = new Lines({ width: 2 });
  private readonly control = new Lines({ width: 2.5 });
  private readonly overlap = new Lines({ width: 1, opacity: 0.4 });
  private queryDots: PointCloud | null = null;
  private databaseDots: PointCloud | null = null;
  private readonly hidden = new Set<LayerName>(["overlap"]); // until someone wants it, because it has many lines
  private mode: ColorMode = "status";
  private factor = 1;
  private isCoarse = false;
  private placed: number[] = []; // queries that are shown and have a position
  private known: number[] = []; // queries that are shown and have a true position
  private selected = -1;

  constructor(private readonly data: ViewData) {
    const { scene, queries } = data;
    this.isShown = new Uint8Array(queries.names.length).fill(1);
    this.points = new PointCloud(scene.points, scene.pointColors, sceneColors().database, 2, scene.pointColors.length > 0);
    this.database = new Frustums({ width: 1, opacity: scene.databaseNames.length > 500 ? 0.5 : 0.9 });
    this.root.add(this.points.object, this.database.group, this.connections.mesh, this.databaseConnections.mesh);
    this.root.add(this.truth.group, this.errors.mesh, this.bearings.mesh, this.queries.group, this.ellipsoids.mesh);
    this.root.add(this.changes.mesh, this.shifts.mesh, this.control.mesh, this.overlap.mesh);
  }

  get numFrustums(): number {
    const drawn = [this.database, this.queries, this.truth].filter((frustums) => frustums.group.visible);
    return drawn.reduce((count, frustums) => count + frustums.numDrawn, 0);
  }

  color(query: number): string {
    return queryColor(this.mode, this.data.queries, this.data.summary, query);
  }

  setMode(mode: ColorMode): void {
    this.mode = mode;
  }

  // Leaves out the image plane of the selected query, because it would cover what is seen from there.
  setSelected(query: number): void {
    this.selected = query;
  }

  setFactor(factor: number): void {
    this.factor = factor;
    this.ellipsoids.setFactor(factor);
  }

  setHidden(layer: LayerName, isHidden: boolean): void {
    if (isHidden) this.hidden.add(layer);
    else this.hidden.delete(layer);
  }

  // Draws less, because the scene moves and the last frames took long.
  setDetail(fraction: number, isCoarse: boolean): void {
    this.points.setFraction(fraction);
    if (isCoarse === this.isCoarse) return;
    this.isCoarse = isCoarse;
    for (const frustums of [this.database, this.queries, this.truth]) frustums.setCoarse(isCoarse);
    this.applyHidden();
  }

  // Rebuilds what depends on colours and filters, but not on the viewpoint.
  rebuild(): void {
    const { scene } = this.data;
    const colors = sceneColors();
    const isDrawn = (query: number) => this.isShown[query] === 1 && hasPosition(scene, query);
    this.databaseConnections.set(linesBetween(scene.databaseConnections, scene.databaseCentres, () => true), colors.database);
    this.changes.set(scene.changes, colors.changes);
    this.shifts.set(scene.shifts, colors.links);
    this.control.set(scene.controlResiduals, Array.from(scene.controlIsNew, (isNew) => (isNew ? colors.control : colors.selected)));
    const withDatabase = linesToOthers(scene.overlapDatabase, scene.queryCentres, scene.databaseCentres, isDrawn, () => true);
    const withOthers = linesBetween(scene.overlapQueries, scene.queryCentres, isDrawn);
    const tints = [colors.database, colors.rays].flatMap((color, i) => Array<string>([withDatabase, withOthers][i].length / 6).fill(color));
    this.overlap.set([...withDatabase, ...withOthers], tints);
    this.connections.set(linesBetween(scene.queryConnections, scene.queryCentres, isDrawn), colors.selected);
    const queries = [...this.isShown.keys()].filter((query) => this.isShown[query] === 1);
    this.placed = queries.filter((query) => hasPosition(scene, query));
    this.known = queries.filter((query) => hasTruth(scene, query));
    const bearings = queries.filter((query) => hasBearing(scene, query));
    this.bearings.set(bearings.flatMap((query) => bearingLine(scene, query)), bearings.map((query) => this.color(query)));
    const compared = this.placed.filter((query) => hasTruth(scene, query));
    const ends = compared.flatMap((i) => [...vec3At(scene.queryCentres, i), ...vec3At(scene.trueCentres, i)]);
    this.errors.set(ends, colors.truth);
    this.applyHidden();
  }

  // Chooses what is drawn as frustums and with ellipsoids: what is large on the screen. The other cameras become dots.
  choose(projector: Projector): void {
    const { scene } = this.data;
    const queries = this.split(projector, this.placed, scene.queryCentres);
    this.queries.set(queryPoses(this.data), queries.large, this.tints(queries.large));
    this.queryDots = this.replaceDots(this.queryDots, queries.small, scene.queryCentres, (query) => this.color(query), 3);
    const images = this.split(projector, [...scene.databaseNames.keys()], scene.databaseCentres);
    const grey = sceneColors().database;
    this.database.set(databasePoses(this.data), images.large, repeated(grey, images.large.length));
    this.databaseDots = this.replaceDots(this.databaseDots, images.small, scene.databaseCentres, () => grey, 2);
    const truth = this.split(projector, this.known, scene.trueCentres).large;
    const truePoses = { centres: scene.trueCentres, rotations: scene.trueRotations, extents: scene.queryExtents };
    this.truth.set(truePoses, truth, repeated(sceneColors().truth, truth.length));
    this.chooseEllipsoids(projector, queries.large);
    this.applyHidden();
  }

  private chooseEllipsoids(projector: Projector, queries: number[]): void {
    const { queryCovariances, queryCentres } = this.data.scene;
    const pixels = (query: number) => {
      const [xx, , , yy, , zz] = queryCovariances.subarray(6 * query, 6 * query + 6);
      const place = projector.project(...vec3At(queryCentres, query));
      const length = NUM_STANDARD_DEVIATIONS * this.factor * Math.sqrt(Math.max(xx, yy, zz));
      return place ? projector.pixels(length, place[2]) : 0;
    };
    const chosen = queries.filter((query) => pixels(query) > SMALL_ELLIPSOID_PIXELS).slice(0, MAX_NUM_ELLIPSOIDS);
    const tints = new Uint8Array(3 * chosen.length);
    chosen.forEach((query, i) => tints.set(colorBytes(this.color(query)), 3 * i));
    this.ellipsoids.set(this.data.scene, chosen, tints);
  }

  // Separates cameras that are large in the window from the others.
  private split(projector: Projector, indices: number[], centres: Float32Array): { large: number[]; small: number[] } {
    const distances = new Float32Array(indices.length);
    for (let i = 0; i < indices.length; i++) {
      const at = 3 * indices[i];
      distances[i] = projector.distanceIfNear(centres[at], centres[at + 1], centres[at + 2]);
    }
    const farthest = projector.pixels(frustumDepth.value, SMALL_FRUSTUM_PIXELS); // Where a frustum becomes small.
    const limit = indices.length > MAX_NUM_FRUSTUMS ? distances.slice().sort()[MAX_NUM_FRUSTUMS] : Infinity;
    const isLarge = (i: number) => distances[i] < farthest && distances[i] <= limit;
    return { large: indices.filter((_, i) => isLarge(i)), small: indices.filter((_, i) => !isLarge(i)) };
  }

  // Draws dots for cameras that are too small or too many for frustums.
  private replaceDots(
    old: PointCloud | null,
    indices: number[],
    centres: Float32Array,
    color: (index: number) => string,
    size: number,
  ): PointCloud | null {
    if (old) {
      this.root.remove(old.object);
      old.object.geometry.dispose();
      old.object.material.dispose();
    }
    if (indices.length === 0) return null;
    const positions = new Float32Array(3 * indices.length);
    const tints = new Uint8Array(3 * indices.length);
    indices.forEach((index, i) => {
      positions.set(centres.subarray(3 * index, 3 * index + 3), 3 * i);
      tints.set(colorBytes(color(index)), 3 * i);
    });
    const dots = new PointCloud(positions, tints, "", size);
    this.root.add(dots.object);
    return dots;
  }

  private tints(queries: number[]): Uint8Array {
    const { summary, queries: table } = this.data;
    const tints = new Uint8Array(4 * queries.length);
    queries.forEach((query, i) => {
      const isHollow = summary.statuses[table.status[query]].name !== "LOCALIZED";
      tints.set([...colorBytes(this.color(query)), isHollow ? LOOKS.hollow : query === this.selected ? LOOKS.open : LOOKS.filled], 4 * i);
    });
    return tints;
  }

  // Shows the layers that are switched on and not empty.
  applyHidden(): void {
    const show = (object: Object3D, layer: LayerName, isWanted = true) => (object.visible = isWanted && !this.hidden.has(layer));
    // Leaves out many lines, like ellipsoids, while less is drawn.
    const most = this.isCoarse ? MAX_NUM_COARSE_LINES : Infinity;
    const count = ({ geometry }: Lines["mesh"]) => geometry.instanceCount > 0 && geometry.instanceCount <= most;
    show(this.points.object, "points");
    show(this.database.group, "database", this.database.numDrawn > 0);
    if (this.databaseDots) show(this.databaseDots.object, "database");
    show(this.databaseConnections.mesh, "connections", count(this.databaseConnections.mesh));
    show(this.connections.mesh, "connections", count(this.connections.mesh));
    show(this.truth.group, "truth", this.truth.numDrawn > 0);
    show(this.errors.mesh, "truth", count(this.errors.mesh));
    show(this.changes.mesh, "changes", count(this.changes.mesh));
    show(this.shifts.mesh, "shifts", count(this.shifts.mesh));
    show(this.control.mesh, "control", count(this.control.mesh));
    show(this.overlap.mesh, "overlap", count(this.overlap.mesh));
    show(this.bearings.mesh, "bearings", count(this.bearings.mesh));
    show(this.ellipsoids.mesh, "ellipsoids", this.ellipsoids.numDrawn > 0 && !this.isCoarse);
  }

  setCameraSize(depth: number): void {
    frustumDepth.value = depth;
  }
}
