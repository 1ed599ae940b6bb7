// Draws many separate lines, each with two ends and a colour.
import { DynamicDrawUsage, InstancedBufferAttribute, InstancedBufferGeometry, Float32BufferAttribute, Mesh, type ShaderMaterial } from "three";
import { colorBytes, lineMaterial, type LineStyle } from "./shaders";

const VERTEX = /* glsl */ `
  attribute vec3 start;
  attribute vec3 finish;
  attribute vec3 tint;
  uniform float width;
  uniform float allDashed;
  varying vec3 lineColor;
  varying float dashed;
  void main() {
    lineColor = tint;
    dashed = allDashed;
    vec3 a = (modelViewMatrix * vec4(start, 1.0)).xyz;
    vec3 b = (modelViewMatrix * vec4(finish, 1.0)).xyz;
    gl_Position = expand(a, b, position.x, position.y, width);
  }
`;

export class Lines {
  readonly mesh: Mesh<InstancedBufferGeometry, ShaderMaterial>;

  constructor(style: LineStyle) {
    this.mesh = new Mesh(new InstancedBufferGeometry(), lineMaterial(VERTEX, style));
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
  }

  setOpacity(opacity: number): void {
    this.mesh.material.uniforms.opacity.value = opacity;
  }

  // Replaces the lines: six numbers each, and a CSS colour each or one for all.
  set(ends: ArrayLike<number>, colors: string | string[]): void {
    const count = ends.length / 6;
    const tints = new Uint8Array(3 * count);
    for (let i = 0; i < count; i++) tints.set(colorBytes(typeof colors === "string" ? colors : colors[i]), 3 * i);
    this.mesh.geometry.dispose();
    this.mesh.geometry = rectangle();
    const both = Float32Array.from(ends);
    const side = (offset: number) => {
      const values = new Float32Array(3 * count);
      for (let i = 0; i < count; i++) values.set(both.subarray(6 * i + offset, 6 * i + offset + 3), 3 * i);
      return new InstancedBufferAttribute(values, 3).setUsage(DynamicDrawUsage);
    };
    this.mesh.geometry.setAttribute("start", side(0));
    this.mesh.geometry.setAttribute("finish", side(3));
    this.mesh.geometry.setAttribute("tint", new InstancedBufferAttribute(tints, 3, true));
    this.mesh.geometry.instanceCount = count;
    this.mesh.visible = count > 0;
  }
}

// Returns the rectangle that each line becomes; x: which end, y: which side.
function rectangle(): InstancedBufferGeometry {
  const geometry = new InstancedBufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute([0, -1, 0, 0, 1, 0, 1, -1, 0, 1, 1, 0], 3));
  geometry.setIndex([0, 2, 1, 1, 2, 3]);
  return geometry;
}
