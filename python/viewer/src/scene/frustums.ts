// Draws cameras as frustums: one geometry, drawn once for each camera. Its edges are thin rectangles, its image plane is
// filled lightly, and a tip marks the upper border. Colours are sRGB bytes.
import {
  BufferGeometry,
  Float32BufferAttribute,
  Group,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  LineSegments,
  Mesh,
  ShaderMaterial,
} from "three";
import { lineMaterial, shared, type LineStyle } from "./shaders";

// Where frustums are: flat arrays as in data.ts.
export interface Poses {
  centres: Float32Array;
  rotations: Float32Array;
  extents: Float32Array;
}

// Alpha bytes of a frustum's colour: with its image plane, without it, or without it and dashed.
export const LOOKS = { filled: 255, open: 230, hollow: 200 };

// How far from the apex the image plane is drawn, for all frustums at once.
export const frustumDepth = { value: 1 };

// Corners of a frustum: across from left to right, down from top to bottom, along from apex to image plane.
const CORNERS = [
  [0, 0, 0],
  [0, 0, 1],
  [1, 0, 1],
  [1, 1, 1],
  [0, 1, 1],
  [0.3, 0, 1],
  [0.7, 0, 1],
  [0.5, -0.2, 1],
];
const EDGES = [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1], [5, 7], [7, 6]];
const NUM_COARSE_EDGES = 8;

const PLACE = /* glsl */ `
  attribute vec3 centre;
  attribute vec4 rotation;
  attribute vec4 extent;
  attribute vec4 tint; // alpha: how the frustum is drawn, as in LOOKS
  uniform float depth;
  vec3 place(vec3 corner) {
    vec2 onPlane = mix(extent.xy, extent.zw, corner.xy);
    vec3 p = depth * corner.z * vec3(onPlane, 1.0);
    return (modelViewMatrix * vec4(centre + p + 2.0 * cross(rotation.xyz, cross(rotation.xyz, p) + rotation.w * p), 1.0)).xyz;
  }
`;

const EDGE_VERTEX = /* glsl */ `
  ${PLACE}
  attribute vec3 finish;
  attribute vec2 place2;
  uniform float width;
  uniform float allDashed;
  varying vec3 lineColor;
  varying float dashed;
  void main() {
    lineColor = tint.rgb;
    dashed = max(allDashed, 1.0 - step(0.85, tint.a));
    gl_Position = expand(place(position), place(finish), place2.x, place2.y, width);
  }
`;

const PLAIN_VERTEX = /* glsl */ `
  ${PLACE}
  varying vec4 color;
  void main() {
    color = tint;
    gl_Position = projectionMatrix * vec4(place(position), 1.0);
  }
`;

const FILL_FRAGMENT = /* glsl */ `
  varying vec4 color;
  uniform float opacity;
  void main() {
    if (color.a < 0.95 && opacity < 1.0) discard;
    gl_FragColor = vec4(color.rgb, opacity);
  }
`;

// Returns each edge as a rectangle: its ends, and which end and side a vertex is at.
function edgeGeometry(): InstancedBufferGeometry {
  const [starts, finishes, places, indices]: number[][] = [[], [], [], []];
  EDGES.forEach(([a, b], edge) => {
    for (const [end, side] of [[0, -1], [0, 1], [1, -1], [1, 1]]) {
      starts.push(...CORNERS[a]);
      finishes.push(...CORNERS[b]);
      places.push(end, side);
    }
    indices.push(...[0, 2, 1, 1, 2, 3].map((vertex) => 4 * edge + vertex));
  });
  const geometry = new InstancedBufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(starts, 3));
  geometry.setAttribute("finish", new Float32BufferAttribute(finishes, 3));
  geometry.setAttribute("place2", new Float32BufferAttribute(places, 2));
  geometry.setIndex(indices);
  return geometry;
}

function plainGeometry(corners: number[]): InstancedBufferGeometry {
  const geometry = new InstancedBufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(CORNERS.flat(), 3));
  geometry.setIndex(corners);
  return geometry;
}

function plainMaterial(opacity: number): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: PLAIN_VERTEX,
    fragmentShader: FILL_FRAGMENT,
    uniforms: { ...shared, depth: frustumDepth, opacity: { value: opacity } },
    transparent: opacity < 1,
    depthWrite: opacity === 1,
    side: 2,
  });
}

export interface FrustumStyle extends LineStyle {
  fill?: number; // opacity of the image plane; 0: not filled
}

export class Frustums {
  readonly group = new Group();
  numDrawn = 0;
  private readonly edges: Mesh<InstancedBufferGeometry>;
  private readonly coarse: LineSegments<InstancedBufferGeometry>;
  private readonly fill: Mesh<InstancedBufferGeometry> | null;

  constructor(style: FrustumStyle) {
    this.edges = new Mesh(edgeGeometry(), lineMaterial(EDGE_VERTEX, style, { depth: frustumDepth }));
    this.coarse = new LineSegments(plainGeometry(EDGES.slice(0, NUM_COARSE_EDGES).flat()), plainMaterial(1));
    this.fill = style.fill ? new Mesh(plainGeometry([1, 4, 2, 2, 4, 3]), plainMaterial(style.fill)) : null;
    for (const object of this.parts) {
      object.frustumCulled = false;
      this.group.add(object);
    }
    this.setCoarse(false);
  }

  private get parts() {
    return this.fill ? [this.edges, this.coarse, this.fill] : [this.edges, this.coarse];
  }

  // Draws lines of one device pixel and no image planes, which is faster.
  setCoarse(isCoarse: boolean): void {
    this.edges.visible = !isCoarse;
    this.coarse.visible = isCoarse;
    if (this.fill) this.fill.visible = !isCoarse;
  }

  // Replaces what is drawn: the cameras `indices`, with four bytes of colour each.
  set(poses: Poses, indices: ArrayLike<number>, tints: Uint8Array): void {
    const take = (values: Float32Array, size: number) => {
      const taken = new Float32Array(size * indices.length);
      for (let i = 0; i < indices.length; i++) {
        for (let k = 0; k < size; k++) taken[size * i + k] = values[size * indices[i] + k];
      }
      return new InstancedBufferAttribute(taken, size);
    };
    const attributes: [string, InstancedBufferAttribute][] = [
      ["centre", take(poses.centres, 3)],
      ["rotation", take(poses.rotations, 4)],
      ["extent", take(poses.extents, 4)],
      ["tint", new InstancedBufferAttribute(tints, 4, true)],
    ];
    for (const { geometry } of this.parts) {
      (geometry as BufferGeometry).dispose(); // Frees the buffers of what was drawn before.
      for (const [name, attribute] of attributes) geometry.setAttribute(name, attribute);
      geometry.instanceCount = indices.length;
    }
    this.group.visible = indices.length > 0;
    this.numDrawn = indices.length;
  }
}
