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

export type LayerName = "points" | "database" | "ellipsoids" | "truth" | "bearings" | "connections";

export function queryPoses({ scene }: ViewData): Poses {
  return { centres: scene.queryCentres, rotations: scene.queryRotations, extents: scene.queryExtents };
}

export function databasePoses({ scene }: ViewData): Poses {
  return { centres: scene.databaseCentres, rotations: scene.databaseRotations, extents: scene.databaseExtents };
}

// Returns the ends of lines between pairs of cameras, those of which both have a position.
function linesBetween(pairs: Uint32Array, centres: Float32Array, isShown: (index: number) => boolean): number[] {
  const ends: number[] = [];
  for (let i = 0; i < pairs.length; i += 2) {
    const [a, b] = [pairs[i], pairs[i + 1]];
    if (isShown(a) && isShown(b)) ends.push(...vec3At(centres, a), ...vec3At(centres, b));
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
  private readonly farQueries: { cloud: PointCloud | null } = { cloud: null };
  private readonly hidden = new Set<LayerName>();
  private mode: ColorMode = "status";
  private factor = 1;
  private isCoarse = false;
  private selected = -1;
  private isStale = true; // True if colours or filters changed since the last choice

  constructor(private readonly data: ViewData) {
    const { scene, queries } = data;
    this.isShown = new Uint8Array(queries.names.length).fill(1);
    this.points = new PointCloud(scene.points, scene.pointColors, sceneColors().database, 2);
    this.database = new Frustums({ width: 1, opacity: scene.databaseNames.length > 500 ? 0.5 : 0.9 });
    this.root.add(this.points.object, this.database.group, this.connections.mesh, this.databaseConnections.mesh);
    this.root.add(this.truth.group, this.errors.mesh, this.bearings.mesh, this.queries.group, this.ellipsoids.mesh);
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
    this.isStale ||= query !== this.selected;
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
    const numImages = scene.databaseNames.length;
    const grey = new Uint8Array([...colorBytes(colors.database), 255]);
    const greys = new Uint8Array(4 * numImages).map((_, i) => grey[i % 4]);
    this.database.set(databasePoses(this.data), [...Array(numImages).keys()], greys);
    this.databaseConnections.set(linesBetween(scene.databaseConnections, scene.databaseCentres, () => true), colors.database);
    this.connections.set(linesBetween(scene.queryConnections, scene.queryCentres, isDrawn), colors.selected);
    const queries = [...this.isShown.keys()].filter((query) => this.isShown[query] === 1);
    const bearings = queries.filter((query) => hasBearing(scene, query));
    this.bearings.set(bearings.flatMap((query) => bearingLine(scene, query)), bearings.map((query) => this.color(query)));
    const compared = queries.filter((query) => hasTruth(scene, query) && hasPosition(scene, query));
    const ends = compared.flatMap((i) => [...vec3At(scene.queryCentres, i), ...vec3At(scene.trueCentres, i)]);
    this.errors.set(ends, colors.truth);
    this.isStale = true;
    this.applyHidden();
  }

  // Chooses the queries that are drawn as frustums and with ellipsoids: those that are largest on the screen, if there are
  // too many for all.
  choose(projector: Projector): void {
    const { scene } = this.data;
    const shown = [...this.isShown.keys()].filter((query) => this.isShown[query] === 1);
    const placed = shown.filter((query) => hasPosition(scene, query));
    const chosen = this.nearest(projector, placed, MAX_NUM_FRUSTUMS);
    this.chooseEllipsoids(projector, chosen);
    if (!this.isStale && placed.length === chosen.length) return this.applyHidden();
    this.isStale = false;
    this.queries.set(queryPoses(this.data), chosen, this.tints(chosen));
    const known = this.nearest(projector, shown.filter((query) => hasTruth(scene, query)), MAX_NUM_FRUSTUMS, scene.trueCentres);
    const truth = new Uint8Array([...colorBytes(sceneColors().truth), 255]);
    const truePoses = { centres: scene.trueCentres, rotations: scene.trueRotations, extents: scene.queryExtents };
    this.truth.set(truePoses, known, new Uint8Array(4 * known.length).map((_, i) => truth[i % 4]));
    this.showAsPoints(placed.length > chosen.length ? placed : []);
    this.applyHidden();
  }

  private chooseEllipsoids(projector: Projector, queries: number[]): void {
    const { queryCovariances, queryCentres } = this.data.scene;
    const isLarge = (query: number) => {
      const [xx, , , yy, , zz] = queryCovariances.subarray(6 * query, 6 * query + 6);
      const place = projector.project(...vec3At(queryCentres, query));
      const length = NUM_STANDARD_DEVIATIONS * this.factor * Math.sqrt(Math.max(xx, yy, zz));
      return place !== null && projector.pixels(length, place[2]) > 1.5;
    };
    const chosen = this.nearest(projector, queries.filter(isLarge), MAX_NUM_ELLIPSOIDS);
    const tints = new Uint8Array(3 * chosen.length);
    chosen.forEach((query, i) => tints.set(colorBytes(this.color(query)), 3 * i));
    this.ellipsoids.set(this.data.scene, chosen, tints);
  }

  // Returns at most `count` of the queries, those in the window first, the nearest of them.
  private nearest(projector: Projector, queries: number[], count: number, centres = this.data.scene.queryCentres): number[] {
    if (queries.length <= count) return queries;
    const distance = (query: number) => {
      const place = projector.project(...vec3At(centres, query));
      if (!place) return Infinity;
      const isInside = place[0] > 0 && place[1] > 0 && place[0] < projector.width && place[1] < projector.height;
      return isInside ? place[2] : 1e6 * place[2];
    };
    const distances = Float32Array.from(queries, distance);
    const limit = distances.slice().sort()[count - 1];
    return queries.filter((_, i) => distances[i] <= limit).slice(0, count);
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

  private showAsPoints(queries: number[]): void {
    const old = this.farQueries.cloud?.object;
    if (old) this.root.remove(old);
    old?.geometry.dispose();
    old?.material.dispose();
    this.farQueries.cloud = null;
    if (queries.length === 0) return;
    const centres = Float32Array.from(queries.flatMap((query) => vec3At(this.data.scene.queryCentres, query)));
    const tints = Uint8Array.from(queries.flatMap((query) => colorBytes(this.color(query))));
    this.farQueries.cloud = new PointCloud(centres, tints, "", 2.5);
    this.root.add(this.farQueries.cloud.object);
  }

  // Shows the layers that are switched on and not empty.
  applyHidden(): void {
    const show = (object: Object3D, layer: LayerName, isWanted = true) => (object.visible = isWanted && !this.hidden.has(layer));
    const count = (object: { geometry: { instanceCount: number } }) => object.geometry.instanceCount > 0;
    show(this.points.object, "points");
    show(this.database.group, "database", this.database.numDrawn > 0);
    show(this.databaseConnections.mesh, "connections", count(this.databaseConnections.mesh));
    show(this.connections.mesh, "connections", count(this.connections.mesh));
    show(this.truth.group, "truth", this.truth.numDrawn > 0);
    show(this.errors.mesh, "truth", count(this.errors.mesh));
    show(this.bearings.mesh, "bearings", count(this.bearings.mesh));
    show(this.ellipsoids.mesh, "ellipsoids", count(this.ellipsoids.mesh) && !this.isCoarse);
  }

  setCameraSize(depth: number): void {
    frustumDepth.value = depth;
  }
}
