// Draws uncertainties: the ellipsoid that holds the position with three standard deviations, enlarged by a factor.
import {
  Float32BufferAttribute,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  Mesh,
  ShaderMaterial,
  SphereGeometry,
} from "three";
import type { Scene } from "../data";
import { quantile, roundDown125, squareRoot } from "./math";

export const NUM_STANDARD_DEVIATIONS = 3;
export const MAX_FACTOR = 1000;

const VERTEX = /* glsl */ `
  attribute vec3 centre;
  attribute vec3 rootA; // symmetric root of the covariance: xx xy xz
  attribute vec3 rootB; // yy yz zz
  attribute vec3 tint;
  uniform float factor;
  varying vec3 color;
  varying vec3 normal2;
  varying vec3 toEye;
  void main() {
    mat3 root = mat3(rootA.x, rootA.y, rootA.z, rootA.y, rootB.x, rootB.y, rootA.z, rootB.y, rootB.z);
    vec4 p = modelViewMatrix * vec4(centre + factor * (root * position), 1.0);
    color = tint;
    normal2 = normalMatrix * (inverse(root / max(root[0][0], max(root[1][1], root[2][2]))) * position);
    toEye = -p.xyz;
    gl_Position = projectionMatrix * p;
  }
`;

// Makes the rim denser than the middle, so that the ellipsoid reads as a body and hides nothing.
const FRAGMENT = /* glsl */ `
  varying vec3 color;
  varying vec3 normal2;
  varying vec3 toEye;
  void main() {
    float facing = abs(dot(normalize(normal2), normalize(toEye)));
    gl_FragColor = vec4(color, mix(0.65, 0.14, smoothstep(0.0, 0.55, facing)));
  }
`;

// Returns the factor, 1 or more, with which a usual ellipsoid is half as large as a frustum.
export function suggestFactor(scene: Scene): number {
  const largest: number[] = [];
  for (let i = 0; i < scene.queryCovariances.length; i += 6) {
    const [xx, , , yy, , zz] = scene.queryCovariances.subarray(i, i + 6);
    largest.push(Math.sqrt(Math.max(xx, yy, zz)));
  }
  const usual = NUM_STANDARD_DEVIATIONS * quantile(largest, 0.5);
  const factor = (0.6 * scene.frustumDepth) / usual;
  return Number.isFinite(factor) ? roundDown125(Math.min(Math.max(factor, 1), MAX_FACTOR)) : 1;
}

export class Ellipsoids {
  readonly mesh: Mesh<InstancedBufferGeometry, ShaderMaterial>;
  numDrawn = 0;

  constructor() {
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { factor: { value: NUM_STANDARD_DEVIATIONS } },
      transparent: true,
      depthWrite: false,
    });
    this.mesh = new Mesh(new InstancedBufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
  }

  setFactor(factor: number): void {
    this.mesh.material.uniforms.factor.value = NUM_STANDARD_DEVIATIONS * factor;
  }

  // Replaces what is drawn: the queries `indices`, which have covariances, with three bytes of colour each.
  set(scene: Scene, indices: number[], tints: Uint8Array): void {
    const sphere = new SphereGeometry(1, indices.length > 200 ? 10 : 20, indices.length > 200 ? 7 : 14);
    const geometry = new InstancedBufferGeometry();
    geometry.setIndex(sphere.index);
    geometry.setAttribute("position", sphere.getAttribute("position") as Float32BufferAttribute);
    const values = [0, 1, 2].map(() => new Float32Array(3 * indices.length));
    indices.forEach((query, i) => {
      const root = squareRoot(scene.queryCovariances.subarray(6 * query, 6 * query + 6));
      values[0].set(scene.queryCentres.subarray(3 * query, 3 * query + 3), 3 * i);
      values[1].set(root.slice(0, 3), 3 * i);
      values[2].set(root.slice(3), 3 * i);
    });
    ["centre", "rootA", "rootB"].forEach((name, k) => geometry.setAttribute(name, new InstancedBufferAttribute(values[k], 3)));
    geometry.setAttribute("tint", new InstancedBufferAttribute(tints, 3, true));
    geometry.instanceCount = indices.length;
    this.mesh.geometry.dispose();
    this.mesh.geometry = geometry;
    this.numDrawn = indices.length;
  }
}
