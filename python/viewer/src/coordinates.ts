// Writes where queries are: in the table, on the query page, and for the clipboard.
import type { Queries, Summary, System } from "./data";
import { visibleText } from "./dom";
import { shownUnit } from "./format";

// Returns the position of a query in one of the systems, in words; null if it has none.
export function positionTexts(queries: Queries, query: number, system: number): string[] | null {
  const { digits } = queries.systems[system];
  const first = 3 * (query * queries.systems.length + system);
  const values = queries.coordinates.subarray(first, first + 3);
  if (!values.every(Number.isFinite)) return null;
  return Array.from(values, (value, axis) => value.toFixed(digits[axis]));
}

// Returns the system that a reader wants first: the last one, which is the most specific.
export function mainSystem(queries: Queries): number {
  return queries.systems.length - 1;
}

// Returns the axes with their units: "x, y, z (m)".
export function axesText({ axes, units }: System): string {
  const unit = shownUnit(units[2]);
  return axes.join(", ") + (unit ? ` (${unit})` : "");
}

function header({ axes, units }: System): string[] {
  return axes.map((axis, i) => (shownUnit(units[i]) ? `${axis} (${shownUnit(units[i])})` : axis));
}

// Returns a table that a spreadsheet takes: positions in all systems, with their standard deviation.
export function positionTable(queries: Queries, summary: Summary, chosen: Iterable<number>): string {
  const unit = shownUnit(summary.unit);
  const head = ["query", "status", ...queries.systems.flatMap(header), `standard deviation${unit ? ` (${unit})` : ""}`];
  const lines = [head.join("\t")];
  for (const query of chosen) {
    const numbers = queries.systems.flatMap((_, system) => positionTexts(queries, query, system) ?? ["", "", ""]);
    const stddev = queries.positionStddev[query];
    const status = summary.statuses[queries.status[query]].name;
    lines.push(
      [
        visibleText(queries.names[query]),
        status,
        ...numbers,
        numbers[0] !== "" && Number.isFinite(stddev) ? String(Number(stddev.toPrecision(3))) : "",
      ].join("\t"),
    );
  }
  return lines.join("\n") + "\n";
}
