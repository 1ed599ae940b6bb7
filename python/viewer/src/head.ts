// Shows what the run was and how it went: title, counts per status, warnings, plots, options.
import { statusColor, statusLabel } from "./colors";
import type { Queries, Summary } from "./data";
import { headPlots } from "./distribution";
import { button, make } from "./dom";
import { formatCount, formatPercent } from "./format";
import type { Selection } from "./selection";
import { markOf, type StatusFilter } from "./table";
import { warningBox } from "./warnings";

function subtitle(summary: Summary): string {
  const counts = [
    summary.folder,
    `${formatCount(summary.numDatabaseImages)} database images`,
    `${formatCount(summary.numPoints)} points`,
  ];
  if (summary.isLeaveOneOut) counts.push("leave-one-out: each query is a database image, localized by the others");
  counts.push(summary.unit === "m" ? "lengths in metres" : "lengths in the unit of the model");
  if (summary.written) counts.push(dateText(summary.written));
  return counts.join(" \u00b7 ");
}

function dateText(iso: string): string {
  return iso.replace("T", " ").replace(/(:\d\d)(:\d\d.*)$/, "$1");
}

// Returns one button a status, which filters the table, and one for all.
function chips(summary: Summary, onFilter: (statuses: StatusFilter) => void): HTMLElement {
  const chosen: StatusFilter = new Set();
  const all = chip("All", summary.numQueries, null);
  const buttons = summary.statuses.map(({ name, count }) => {
    const element = chip(statusLabel(name), count, name);
    element.title = `${name}: ${formatPercent(count / summary.numQueries)} of the queries; click to show only these`;
    return element;
  });
  const show = () => {
    all.setAttribute("aria-pressed", String(chosen.size === 0));
    buttons.forEach((element, i) => element.setAttribute("aria-pressed", String(chosen.has(i))));
    onFilter(new Set(chosen));
  };
  all.addEventListener("click", () => {
    chosen.clear();
    show();
  });
  buttons.forEach((element, i) =>
    element.addEventListener("click", () => {
      if (!chosen.delete(i)) chosen.add(i);
      show();
    }),
  );
  all.setAttribute("aria-pressed", "true");
  return make("div", { class: "chips", role: "group", "aria-label": "Show queries by status" }, all, ...buttons);
}

function chip(label: string, count: number, status: string | null): HTMLButtonElement {
  const element = make("button", { type: "button", class: "chip", "aria-pressed": "false" });
  if (status) {
    const mark = markOf(status);
    mark.style.color = statusColor(status);
    element.append(mark);
  }
  element.append(make("strong", {}, formatCount(count)), label);
  return element;
}

function pairTable(caption: string, rows: [string, string][]): HTMLElement | null {
  if (rows.length === 0) return null;
  const body = rows.map(([key, value]) => make("tr", {}, make("th", { scope: "row" }, key), make("td", {}, value)));
  return make("table", { class: "pairs" }, make("caption", {}, caption), ...body);
}

// Returns a button, and what it shows or hides.
function runDetails(summary: Summary): [HTMLElement, HTMLElement] {
  const inputs = pairTable(
    "Inputs",
    summary.inputs.map(({ option, value }) => [option, value]),
  );
  const options = pairTable(
    "Options",
    summary.options.map(({ name, value }) => [name, value]),
  );
  const program = summary.program.split("\n").filter((line) => line.trim() !== "");
  const versions = pairTable(
    "Versions",
    program.map((line, i) => [i === 0 ? "Program" : "", line]),
  );
  const details = make("section", { class: "card run", hidden: true }, make("div", {}, inputs, versions), options);
  const toggle = button("Inputs, options, versions", () => show(), {
    class: "button run-button",
    "aria-expanded": "false",
  });
  const show = () => {
    details.hidden = !details.hidden;
    toggle.setAttribute("aria-expanded", String(!details.hidden));
  };
  return [toggle, details];
}

export interface HeadActions {
  onFilter(statuses: StatusFilter): void;
  onOpen(): void;
}

export function makeHead(summary: Summary, queries: Queries, selection: Selection, actions: HeadActions): HTMLElement {
  const [toggle, details] = runDetails(summary);
  const bar = chips(summary, actions.onFilter);
  bar.append(toggle);
  const plots = headPlots(summary, queries);
  const overview = make(
    "div",
    { class: summary.warnings.length > 0 ? "overview" : "overview is-calm" },
    warningBox(summary, selection, actions.onOpen),
    plots.length > 0 && make("div", { class: "card plots" }, ...plots),
  );
  return make(
    "header",
    { class: "head" },
    make("h1", {}, summary.title),
    make("p", { class: "subtitle" }, subtitle(summary)),
    bar,
    details,
    overview,
  );
}
