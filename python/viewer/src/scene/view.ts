// Describes what scene and plan have in common: their input, and what the page can ask of them.
import { statusLabel, type ColorMode } from "../colors";
import type { Details, Queries, Scene, Summary } from "../data";
import { visibleText } from "../dom";

export interface ViewData {
  summary: Summary;
  queries: Queries;
  scene: Scene;
  loadDetails(query: number): Promise<{ details: Details; row: number }>;
}

export interface ViewState {
  viewer: "webgl" | "plan";
  numDrawnFrustums: number;
  numDrawnPoints: number;
  frameMilliseconds: number; // mean of the last frames of a motion; 0 before the first one
  projectedQuery(query: number): [number, number]; // client pixels of the apex of its frustum; NaN if it is not in view
}

export interface SceneView {
  setColorMode(mode: ColorMode): void;
  setVisible(visible: Uint8Array): void; // 1 a query that the filters leave
  state(): ViewState;
  measure(isCoarse: boolean): number; // draws a frame, waits until it is finished, and returns its milliseconds
  dispose(): void;
}

// Event that bubbles from the host when the graphics card takes the context away.
export const SCENE_LOST = "scenelost";

// Returns true if a query has a position.
export function hasPosition(scene: Scene, query: number): boolean {
  return Number.isFinite(scene.queryCentres[3 * query]);
}

// Returns true if all that is known of a query's position is a line.
export function hasBearing(scene: Scene, query: number): boolean {
  return !hasPosition(scene, query) && Number.isFinite(scene.bearings[6 * query]);
}

export function hasTruth(scene: Scene, query: number): boolean {
  return scene.trueCentres.length > 0 && Number.isFinite(scene.trueCentres[3 * query]);
}

// Returns both ends of a query's bearing line, of which only a part is drawn because it has no end.
export function bearingLine(scene: Scene, query: number): number[] {
  const length = Math.min(0.35 * scene.size, 40 * scene.frustumDepth);
  const [x, y, z, dx, dy, dz] = scene.bearings.subarray(6 * query, 6 * query + 6);
  return [x, y, z, x + length * dx, y + length * dy, z + length * dz];
}

// Returns the name, the status and the confidence of a query, as tooltips and labels show them.
export function describeQuery(data: ViewData, query: number): string {
  const { queries, summary } = data;
  const confidence = queries.confidence[query];
  const status = statusLabel(summary.statuses[queries.status[query]].name);
  return `${visibleText(queries.names[query])}: ${status}${Number.isFinite(confidence) ? `, confidence ${confidence.toFixed(2)}` : ""}`;
}

// Returns the database images on which the pose of a query rests.
export async function usedDatabaseImages(data: ViewData, query: number): Promise<number[]> {
  const { details, row } = await data.loadDetails(query);
  const images: number[] = [];
  for (let pair = details.pairOffsets[row]; pair < details.pairOffsets[row + 1]; pair++) {
    if (details.pairIsUsed[pair] === 1) images.push(details.pairImages[pair]);
  }
  return images;
}
