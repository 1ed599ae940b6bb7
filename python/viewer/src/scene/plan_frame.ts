// Draws what frames the plan: coordinates along its borders and a scale bar.
import type { Summary } from "../data";
import { makeSvg } from "../dom";
import { formatLength } from "../format";
import type { Ground, Vec2 } from "./ground";
import { roundDown125 } from "./math";

// Maps the ground to the picture: `scale` pixels for one unit, y up on the ground and down in the picture.
export interface Mapping {
  width: number;
  height: number;
  scale: number;
  shift: Vec2; // where the middle of the ground's coordinates is in the picture
}

const MARGIN = 6;

// Returns the values of round coordinates between two ends, in relative coordinates.
function ticks(from: number, to: number, offset: number, step: number): number[] {
  const values: number[] = [];
  for (let k = Math.ceil((from + offset) / step); k * step <= to + offset; k++) values.push(k * step - offset);
  return values;
}

// Writes a coordinate with all the digits that its step needs, and no exponent.
function coordinateText(value: number, step: number): string {
  const text = value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
}

function tickMarks(mapping: Mapping, ground: Ground, isAcross: boolean): SVGElement[] {
  const axis = isAcross ? ground.across : ground.along;
  const length = isAcross ? mapping.width : mapping.height;
  const start = isAcross ? -mapping.shift[0] / mapping.scale : (mapping.shift[1] - mapping.height) / mapping.scale;
  const step = roundDown125((isAcross ? 190 : 110) / mapping.scale);
  return ticks(start, start + length / mapping.scale, axis.offset, step).flatMap((value) => {
    const text = coordinateText(ground.coordinate(axis, value), step);
    const at = isAcross ? mapping.shift[0] + value * mapping.scale : mapping.shift[1] - value * mapping.scale;
    if (at < 90 || at > length - 40) return [];
    const line = isAcross ? { x1: at, x2: at, y1: 0, y2: mapping.height } : { y1: at, y2: at, x1: 0, x2: mapping.width };
    const place = isAcross
      ? { x: at + 3, y: mapping.height - MARGIN }
      : { x: mapping.width - 3, y: at - 3, "text-anchor": "end" };
    return [makeSvg("line", { class: "plan-grid", ...line }), makeSvg("text", { class: "plan-text", ...place }, `${axis.name} ${text}`)];
  });
}

// Returns a bar whose length is round.
function scaleBar(mapping: Mapping, summary: Summary): SVGElement[] {
  const length = roundDown125(160 / mapping.scale);
  const [left, top] = [14, 22];
  const right = left + length * mapping.scale;
  const path = `M${left} ${top - 5}V${top}H${right}V${top - 5}`;
  const text = summary.unit ? formatLength(length, summary, 1) : String(Number(length.toPrecision(1)));
  return [
    makeSvg("path", { class: "plan-scale", d: path }),
    makeSvg("text", { class: "plan-text plan-strong", x: (left + right) / 2, y: top - 7, "text-anchor": "middle" }, text),
  ];
}

export function drawFrame(layer: SVGGElement, mapping: Mapping, ground: Ground): void {
  layer.replaceChildren(...tickMarks(mapping, ground, true), ...tickMarks(mapping, ground, false));
}

export function drawScale(layer: SVGGElement, mapping: Mapping, summary: Summary): void {
  layer.replaceChildren(...scaleBar(mapping, summary));
}
