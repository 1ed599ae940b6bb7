// Computes with small vectors and matrices in flat arrays.

export type Vec3 = [number, number, number];

// Returns vector `index` of a flat array.
export function vec3At(values: ArrayLike<number>, index: number): Vec3 {
  return [values[3 * index], values[3 * index + 1], values[3 * index + 2]];
}

export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const scaled = (a: Vec3, factor: number): Vec3 => [a[0] * factor, a[1] * factor, a[2] * factor];
export const sum = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

export function normalized(a: Vec3): Vec3 {
  const length = Math.hypot(...a);
  return length > 0 ? scaled(a, 1 / length) : [0, 0, 0];
}

// Returns two unit vectors that are perpendicular to `up` and to each other: right and forward on a map.
export function groundAxes(up: Vec3): [Vec3, Vec3] {
  const start: Vec3 = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const right = normalized(sum(start, scaled(up, -dot(start, up))));
  return [right, cross(up, right)];
}

// Returns R v for the rotation of quaternion `index` (x, y, z, w).
export function rotate(quaternions: ArrayLike<number>, index: number, v: Vec3): Vec3 {
  const q: Vec3 = [quaternions[4 * index], quaternions[4 * index + 1], quaternions[4 * index + 2]];
  const twice = scaled(cross(q, v), 2);
  return sum(sum(v, scaled(twice, quaternions[4 * index + 3])), cross(q, twice));
}

// Returns the `fraction` quantile of values that need not be sorted; NaN if there are none.
export function quantile(values: ArrayLike<number>, fraction: number): number {
  const sorted = Float64Array.from(values).filter(Number.isFinite).sort();
  return sorted.length > 0 ? sorted[Math.round(fraction * (sorted.length - 1))] : NaN;
}

// Returns the largest of 1, 2, 5, 10, 20, 50, ... that is not larger than `value`.
export function roundDown125(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  const mantissa = value / power;
  return power * (mantissa >= 5 ? 5 : mantissa >= 2 ? 2 : 1);
}

export interface Eigen {
  values: number[];
  vectors: Vec3[]; // vectors[i] belongs to values[i]
}

// Rotates rows and columns p and q of a symmetric matrix so that its element (p, q) becomes zero.
function annihilate(a: number[][], v: number[][], p: number, q: number): void {
  if (a[p][q] === 0) return;
  const theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
  const t = (theta >= 0 ? 1 : -1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
  const c = 1 / Math.sqrt(t * t + 1);
  const s = t * c;
  for (let k = 0; k < 3; k++) {
    [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
  }
  for (let k = 0; k < 3; k++) {
    [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
    [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
  }
}

// Returns the eigenvalues and eigenvectors of a symmetric matrix (xx xy xz yy yz zz) by Jacobi's method.
export function eigenSymmetric(m: ArrayLike<number>): Eigen {
  const a = [
    [m[0], m[1], m[2]],
    [m[1], m[3], m[4]],
    [m[2], m[4], m[5]],
  ];
  const v = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  for (let sweep = 0; sweep < 12; sweep++) {
    const rest = Math.abs(a[0][1]) + Math.abs(a[0][2]) + Math.abs(a[1][2]);
    if (!(rest > 1e-12 * (Math.abs(a[0][0]) + Math.abs(a[1][1]) + Math.abs(a[2][2])))) break;
    annihilate(a, v, 0, 1);
    annihilate(a, v, 0, 2);
    annihilate(a, v, 1, 2);
  }
  const values = [a[0][0], a[1][1], a[2][2]];
  return { values, vectors: [0, 1, 2].map((i) => [v[0][i], v[1][i], v[2][i]] as Vec3) };
}

// Returns the symmetric square root (xx xy xz yy yz zz) of a covariance: it turns the unit sphere into the ellipsoid of one
// standard deviation. Standard deviations below a hundredth of the largest one are raised, because a flat ellipsoid has no
// normals.
export function squareRoot(covariance: ArrayLike<number>): number[] {
  const { values, vectors } = eigenSymmetric(covariance);
  const floor = 1e-4 * Math.max(...values, 1e-30);
  const root = [0, 0, 0, 0, 0, 0];
  vectors.forEach((u, i) => {
    const stddev = Math.sqrt(Math.max(values[i], floor));
    [0, 0, 0, 1, 1, 2].forEach((row, k) => (root[k] += stddev * u[row] * u[[0, 1, 2, 1, 2, 2][k]]));
  });
  return root;
}
