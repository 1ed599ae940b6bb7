// Draws the scene's points as squares of constant size on the screen, as many of them as there is time for.
import { BufferAttribute, BufferGeometry, Points, ShaderMaterial } from "three";
import { colorBytes, shared } from "./shaders";

const VERTEX = /* glsl */ `
  attribute vec3 tint;
  uniform float size;
  uniform float pixelRatio;
  uniform float darkness;
  uniform float isPhotographed;
  varying vec3 color;
  void main() {
    // Keeps points apart from the background, which may have the colour of the photos' sky or shadows.
    color = isPhotographed > 0.5 ? mix(0.85 * tint, 0.2 + 0.8 * tint, darkness) : tint;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    gl_PointSize = size * pixelRatio;
  }
`;

const FRAGMENT = /* glsl */ `
  varying vec3 color;
  void main() {
    gl_FragColor = vec4(color, 1.0);
  }
`;

function repeated(color: [number, number, number], count: number): Uint8Array {
  const tints = new Uint8Array(3 * count);
  for (let i = 0; i < tints.length; i++) tints[i] = color[i % 3];
  return tints;
}

export class PointCloud {
  readonly object: Points<BufferGeometry, ShaderMaterial>;
  readonly count: number;
  numDrawn = 0;

  // `colors` may be empty; then all points have the colour `plain`. Any first part of the points shows the whole scene,
  // because the report orders them so.
  constructor(positions: Float32Array, colors: Uint8Array, plain: string, size: number, isPhotographed = false) {
    this.count = positions.length / 3;
    const tints = colors.length > 0 ? colors : repeated(colorBytes(plain), this.count);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    geometry.setAttribute("tint", new BufferAttribute(tints, 3, true));
    const uniforms = { ...shared, size: { value: size }, isPhotographed: { value: isPhotographed ? 1 : 0 } };
    this.object = new Points(geometry, new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms }));
    this.object.frustumCulled = false;
    this.setFraction(1);
  }

  setSize(cssPixels: number): void {
    this.object.material.uniforms.size.value = cssPixels;
  }

  setFraction(fraction: number): void {
    this.numDrawn = Math.round(fraction * this.count);
    this.object.geometry.setDrawRange(0, this.numDrawn);
  }
}
