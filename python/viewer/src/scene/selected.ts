// Draws the selected query: a thick frustum, green rays to its points, purple links to the database images that it used.
import { Group, type BufferGeometry, type Points, type ShaderMaterial } from "three";
import { sceneColors } from "../colors";
import { Frustums } from "./frustums";
import { databasePoses, queryPoses, repeated, type Layers } from "./layers";
import { Lines } from "./lines";
import { quantile, vec3At } from "./math";
import { PointCloud } from "./points";
import { bearingLine, hasBearing, hasPosition, usedDatabaseImages, type ViewData } from "./view";

const MAX_NUM_RAYS = 3000;

// Returns the points of a query as indices of the scene's points.
function pointsOf({ scene }: ViewData, query: number): Uint32Array {
  return scene.pointIndices.subarray(scene.pointOffsets[query], scene.pointOffsets[query + 1]);
}

// Returns how far the points of a query usually are; half the scene's size if it has none.
export function pointDistance(data: ViewData, query: number): number {
  const [x, y, z] = vec3At(data.scene.queryCentres, query);
  const distances = Array.from(pointsOf(data, query), (point) => {
    const [px, py, pz] = vec3At(data.scene.points, point);
    return Math.hypot(px - x, py - y, pz - z);
  });
  return quantile(distances, 0.5) || 0.5 * data.scene.size;
}

export class SelectedQuery {
  readonly root = new Group();
  query = -1;
  numPoints = 0;
  numImages = 0;
  private readonly halo = new Frustums({ width: 5 });
  private readonly frustum = new Frustums({ width: 2.4 });
  private readonly hiddenPart = new Frustums({ width: 2, opacity: 0.45, isHiddenPart: true });
  private readonly rays = new Lines({ width: 1, opacity: 0.5 });
  private readonly links = new Lines({ width: 2 });
  private readonly images = new Frustums({ width: 2.2 });
  private readonly bearing = new Lines({ width: 4 });
  private cloud: Points<BufferGeometry, ShaderMaterial> | null = null;

  constructor(
    private readonly data: ViewData,
    private readonly layers: Layers,
    private readonly changed: () => void,
  ) {
    const lines = [this.rays, this.links, this.bearing].map(({ mesh }) => mesh);
    const frustums = [this.images, this.hiddenPart, this.halo, this.frustum].map(({ group }) => group);
    this.root.add(...lines, ...frustums);
    [this.rays.mesh, this.links.mesh, this.images.group, this.hiddenPart.group, this.halo.group, this.frustum.group].forEach(
      (object, order) => object.traverse((part) => (part.renderOrder = 10 + order)),
    );
  }

  // Draws a query, or none (-1); the links follow when the page has read its details.
  show(query: number): void {
    this.query = query;
    this.numImages = 0;
    const isPlaced = query >= 0 && hasPosition(this.data.scene, query);
    const poses = queryPoses(this.data);
    const indices = isPlaced ? [query] : [];
    const color = query >= 0 ? this.layers.color(query) : "#000000";
    this.halo.set(poses, indices, repeated(sceneColors().selected, 1));
    this.frustum.set(poses, indices, repeated(color, 1));
    this.hiddenPart.set(poses, indices, repeated(color, 1));
    this.bearing.set(query >= 0 && hasBearing(this.data.scene, query) ? bearingLine(this.data.scene, query) : [], color);
    this.showRays(isPlaced ? query : -1);
    this.showLinks([]);
    if (query >= 0) void this.addLinks(query);
  }

  private showRays(query: number): void {
    const { scene } = this.data;
    const green = sceneColors().rays;
    const points = query < 0 ? new Uint32Array() : pointsOf(this.data, query);
    const step = Math.max(1, points.length / MAX_NUM_RAYS);
    const ends: number[] = [];
    for (let i = 0; i < points.length; i += step) {
      ends.push(...vec3At(scene.queryCentres, query), ...vec3At(scene.points, points[Math.floor(i)]));
    }
    this.rays.set(ends, green);
    // Makes many rays fainter, so that they do not hide what is behind them.
    this.rays.setOpacity(Math.min(0.6, Math.max(0.1, 100 / (ends.length / 6))));
    this.numPoints = points.length;
    if (this.cloud) this.root.remove(this.cloud);
    this.cloud?.geometry.dispose();
    this.cloud?.material.dispose();
    const positions = Float32Array.from([...points].flatMap((point) => vec3At(scene.points, point)));
    this.cloud = new PointCloud(positions, new Uint8Array(), green, 3.5).object;
    this.root.add(this.cloud);
  }

  private async addLinks(query: number): Promise<void> {
    try {
      const images = await usedDatabaseImages(this.data, query);
      if (this.query !== query) return;
      this.showLinks(images);
      this.changed();
    } catch {
      // Leaves the links out: the query page says why the details cannot be read.
    }
  }

  private showLinks(images: number[]): void {
    const { scene } = this.data;
    const purple = sceneColors().links;
    this.numImages = images.length;
    this.images.set(databasePoses(this.data), images, repeated(purple, images.length));
    const isPlaced = this.query >= 0 && hasPosition(scene, this.query);
    const ends = isPlaced
      ? images.flatMap((image) => [...vec3At(scene.queryCentres, this.query), ...vec3At(scene.databaseCentres, image)])
      : [];
    this.links.set(ends, purple);
  }
}
