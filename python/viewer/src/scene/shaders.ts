// Draws lines as thin rectangles that face the viewer, because WebGL's own lines are one device pixel wide.
import { Color, NormalBlending, ShaderMaterial, Vector2 } from "three";

// Uniforms that all materials share; the scene sets them before each frame.
export const shared = {
  viewport: { value: new Vector2(1, 1) }, // device pixels
  pixelRatio: { value: 1 },
  darkness: { value: 0 }, // 1 if the page has a dark background
};

// Puts a vertex of the line a-b (in the view's axes) at its place: at a or b (end = 0 or 1), on its left or right (side). A
// line that begins behind the near plane is cut there. `dash` lets the fragment shader measure pixels along the line.
export const EXPAND = /* glsl */ `
  uniform vec2 viewport;
  uniform float pixelRatio;
  varying vec2 dash;
  vec3 cutAt(vec3 p, vec3 q, float limit) {
    return p.z > limit && q.z < limit ? mix(p, q, (limit - p.z) / (q.z - p.z)) : p;
  }
  vec4 expand(vec3 a, vec3 b, float end, float side, float width) {
    float limit = -1.001 * projectionMatrix[3][2] / (projectionMatrix[2][2] - 1.0);
    if (a.z > limit && b.z > limit) return vec4(2.0, 2.0, 2.0, 1.0);
    vec4 ca = projectionMatrix * vec4(cutAt(a, b, limit), 1.0);
    vec4 cb = projectionMatrix * vec4(cutAt(b, a, limit), 1.0);
    vec2 along = (cb.xy / cb.w - ca.xy / ca.w) * viewport * 0.5;
    float pixels = length(along);
    along = pixels > 1e-4 ? along / pixels : vec2(1.0, 0.0);
    vec4 c = end < 0.5 ? ca : cb;
    vec2 move = (vec2(-along.y, along.x) * side + along * (2.0 * end - 1.0) * 0.7) * width * pixelRatio;
    dash = vec2(end * pixels / pixelRatio * c.w, c.w);
    c.xy += move / viewport * c.w;
    return c;
  }
`;

export interface LineStyle {
  width: number; // CSS pixels
  opacity?: number;
  isDashed?: boolean;
  isHiddenPart?: boolean; // drawn only where something else is in front
}

const FRAGMENT = /* glsl */ `
  uniform float opacity;
  uniform float dashLength;
  varying vec3 lineColor;
  varying vec2 dash;
  varying float dashed;
  void main() {
    if (dashed * dashLength > 0.0 && fract(dash.x / dash.y / dashLength) > 0.55) discard;
    gl_FragColor = vec4(lineColor, opacity);
  }
`;

// Returns a material whose vertex shader sets lineColor and dashed and calls expand.
export function lineMaterial(vertexShader: string, style: LineStyle, uniforms: Record<string, { value: unknown }> = {}) {
  const opacity = style.opacity ?? 1;
  return new ShaderMaterial({
    vertexShader: EXPAND + vertexShader,
    fragmentShader: FRAGMENT,
    uniforms: {
      ...shared,
      ...uniforms,
      width: { value: style.width },
      opacity: { value: opacity },
      dashLength: { value: 7 },
      allDashed: { value: style.isDashed ? 1 : 0 },
    },
    transparent: opacity < 1,
    depthWrite: opacity === 1,
    depthTest: !style.isHiddenPart,
    blending: NormalBlending,
    side: 2,
  });
}

const parsed = new Map<string, [number, number, number]>();

// Returns the sRGB bytes of a CSS colour.
export function colorBytes(css: string): [number, number, number] {
  let bytes = parsed.get(css);
  if (!bytes) {
    const hex = new Color(css).getHex();
    bytes = [hex >> 16, (hex >> 8) & 255, hex & 255];
    parsed.set(css, bytes);
  }
  return bytes;
}
