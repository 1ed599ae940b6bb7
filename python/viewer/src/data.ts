// Describes what a report page holds: the contract between python/colmap_lazyloc/report, which writes it, and the viewer.
//
// The page holds chunks (chunk.ts), each in an element
//   <script type="text/plain" data-chunk="NAME">base64</script>
// and photos, JPEG, in
//   <script type="text/plain" data-photo="INDEX">base64</script>
// A page that was written with --split has neither; it has <html data-split> instead, and beside it the files
// chunks/NAME.js, each the call `report.addChunk("NAME", "base64")`, and photos/INDEX.jpg.
//
// Queries are numbered in the order in which the report lists them, the least certain first; database images in the order
// of their names. Positions are relative to `origin` (in double precision, so that they survive single precision). A number
// that is unknown is NaN; a missing index is -1. Camera frames are COLMAP's: x right, y down, z forward.

export type Plot = { confidence: number[]; coverage: number[]; risk: number[] };

// An item of the warning box; `query` is the index of a query, or -1.
export type WarningItem = { name: string; query: number; text: string };
export type Warning = { title: string; explanation: string; items: WarningItem[]; numItems: number };

// Chunk "summary": values only.
export interface Summary {
  title: string; // what the run has found
  folder: string; // of the run, and the one above it
  written: string; // date and time of the run, ISO 8601
  program: string; // versions of the program that ran, as it names them
  numQueries: number;
  numDatabaseImages: number;
  numPoints: number; // in the run; the scene may show fewer
  hasTruth: boolean;
  isLeaveOneOut: boolean;
  unit: string; // of lengths: "m", or "units" if it is unknown
  minConfidence: number;
  statuses: { name: string; count: number }[]; // those that occur; indices of Queries.status
  inputs: { option: string; value: string }[]; // paths
  options: { name: string; value: string }[]; // those that differ from their defaults come first
  warnings: Warning[];
  riskCoverage: Plot | null;
  auroc: number | null;
  numShown: { points: number; photos: number };
  notes: string[]; // what is missing in this report and why, one sentence each
}

// Chunk "queries": what the table shows; n queries.
export interface Queries {
  names: string[];
  reasons: string[]; // empty if localized
  status: Uint8Array; // index into Summary.statuses
  confidence: Float32Array;
  positionStddev: Float32Array; // the largest of the three
  rotationStddevDeg: Float32Array;
  numTracks: Int32Array; // -1 if unknown
  reprojectionErrorPx: Float32Array;
  numImages: Uint16Array; // database images on which the pose rests
  seconds: Float32Array;
  positionError: Float32Array; // NaN without truth
  rotationErrorDeg: Float32Array;
  photo: Int32Array; // index of the photo, or -1
  isDrawn: Uint8Array; // 1 if there is a chunk "drawing/INDEX"
  frame: Int32Array; // index into `frames`, or -1 for an image without a rig
  frames: string[];
  systems: System[];
  coordinates: Float64Array; // 3 x systems n: in the first system, the second ...; NaN without a position
}

// A system of coordinates; of each: the axes, their units ("" if unknown), and digits after the point.
export interface System {
  name: string;
  axes: string[];
  units: string[];
  digits: number[];
}

// Chunk "scene".
export interface Scene {
  origin: [number, number, number];
  size: number; // diagonal of the box around cameras and points, without outliers
  frustumDepth: number; // suggested depth of a frustum
  up: [number, number, number]; // unit vector that is up for most images
  databaseNames: string[];
  databaseCentres: Float32Array; // 3 m
  databaseRotations: Float32Array; // 4 m: quaternion x y z w (three.js's order) of world_from_cam
  databaseExtents: Float32Array; // 4 m: left, top, right, bottom border of the image on the plane z = 1
  queryCentres: Float32Array; // 3 n; NaN without a pose
  queryRotations: Float32Array; // 4 n; known for some queries without a position
  queryExtents: Float32Array; // 4 n
  queryCovariances: Float32Array; // 6 n: xx xy xz yy yz zz of the position's covariance in the world, in unit^2
  trueCentres: Float32Array; // 3 n, or empty without truth
  trueRotations: Float32Array; // 4 n
  bearings: Float32Array; // 6 n: where a bearing line begins, and its direction (unit vector); NaN for other queries
  points: Float32Array; // 3 p
  pointColors: Uint8Array; // 3 p, sRGB; or empty if no photo was read
  pointOffsets: Uint32Array; // n + 1: query i has the points pointIndices[pointOffsets[i] .. pointOffsets[i + 1])
  pointIndices: Uint32Array; // stored as differences "pointDeltas" (modulo 2^32), which data.ts sums up
  queryConnections: Uint32Array; // pairs of queries that one frame or trajectory joins
  databaseConnections: Uint32Array; // pairs of database images of one frame
  shifts: Float32Array; // 6 l: how joint adjustment has moved new photos, shiftFactor times as long
  shiftFactor: number;
  controlResiduals: Float32Array; // 6 l: from surveyed points to where the photos of a set have them, controlFactor times as long
  controlFactor: number;
  controlIsNew: Uint8Array; // l: 1 the set of new photos, 0 of database images
  overlapDatabase: Uint32Array; // pairs of a new photo and a database image with common matches
  overlapQueries: Uint32Array; // pairs of new photos with common matches
  changes: Float32Array; // 6 l: lines around things that have changed between two epochs, and from where they have moved
}

// Chunk "details/BLOCK": what the query page shows in words, for the queries BLOCK * DETAILS_PER_BLOCK and on; k queries.
export const DETAILS_PER_BLOCK = 1000;
export interface Details {
  stages: string[]; // names of the stages, in the order in which they run
  seconds: Float32Array; // k x stages
  pairOffsets: Uint32Array; // k + 1
  pairImages: Uint32Array; // index of the database image
  pairNumInliers: Uint32Array;
  pairIsUsed: Uint8Array; // 1 if the pose rests on the pair
  pairRotationErrorsDeg: Float32Array; // NaN if the pair was not used, or if the focal length was unknown
  pairDirectionErrorsDeg: Float32Array;
  // Rows of a table "what is known of the query": label, text; already written for a reader.
  facts: [string, string][][];
  commands: string[]; // command that repeats this query alone
}

// Chunk "drawing/QUERY": what is drawn over the photos of a query; q inliers, r rejected matches.
export interface Drawing {
  size: [number, number]; // of the query image, in pixels; coordinates below are in COLMAP's pixels of the full image
  images: { image: number; photo: number; size: [number, number]; numInliers: number }[]; // at most three database images
  inlierImages: Uint8Array; // q: index into images
  inlierXy: Float32Array; // 2 q: in the query
  inlierDatabaseXy: Float32Array; // 2 q
  residuals: Float32Array; // 2 t: observed minus projected, of the query's own observations; empty if unknown
  residualXy: Float32Array; // 2 t
  rejectedImages: Uint8Array; // r
  rejectedXy: Float32Array; // 2 r
  rejectedDatabaseXy: Float32Array; // 2 r
}
