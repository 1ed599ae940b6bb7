// Shows all that is known of the selected query.
import { statusLabel } from "./colors";
import { EXPLANATIONS } from "./columns";
import { axesText, positionTexts } from "./coordinates";
import { copyButton } from "./copy";
import type { Details, Queries, Scene, Summary } from "./data";
import { button, help, make, reducedMotion, visibleText } from "./dom";
import { makeFigure } from "./drawing";
import * as format from "./format";
import { loadDetails, loadDrawing } from "./load";
import { pairTable } from "./pair_table";
import type { Selection } from "./selection";
import { statusMark, type Table } from "./table";
import { timeBar } from "./times";

const HEAD_FACTS = new Set(["Status", "Reason", "Confidence"]);

interface PageData {
  summary: Summary;
  queries: Queries;
  scene: Scene;
}

export class QueryPage {
  readonly element = make("section", { class: "card query-page", "aria-label": "Selected query", tabindex: -1 });
  private numShown = 0; // tells whether another query was selected while this one's details were loading

  constructor(
    private readonly data: PageData,
    private readonly selection: Selection,
    private readonly table: Table,
  ) {
    selection.onChange(() => void this.show());
  }

  open(): void {
    this.element.scrollIntoView({ behavior: reducedMotion() ? "auto" : "smooth", block: "start" });
    this.element.focus({ preventScroll: true });
  }

  // Updates what depends on the filter of the table.
  updateSteps(): void {
    const bar = this.element.querySelector(".steps");
    if (bar) bar.replaceWith(this.steps());
  }

  // Shows the selected query; resolves when its details are there.
  async show(): Promise<void> {
    const { query, unknownName } = this.selection;
    this.numShown++;
    this.element.classList.toggle("is-empty", query < 0 && unknownName === null);
    if (unknownName !== null) {
      const text = `The address names "${visibleText(unknownName)}", but this run has no query of this name.`;
      this.element.replaceChildren(make("p", { class: "callout" }, text));
    } else if (query < 0) {
      const text =
        "Select a query in the table or in the scene to see its photo, its matches and what its pose rests on.";
      this.element.replaceChildren(make("p", { class: "muted hint" }, text));
    } else {
      const body = make("div", { class: "query-body" });
      this.element.replaceChildren(this.header(query), ...this.reason(query), this.positions(query), this.figures(query), body);
      await this.fill(body, query, this.numShown).catch((error: unknown) => {
        body.replaceChildren(make("p", { class: "callout" }, error instanceof Error ? error.message : String(error)));
      });
    }
  }

  private steps(): HTMLElement {
    const step = (label: string, offset: number, key: string) => {
      const query = this.table.neighbour(offset);
      const title = `${key} on the keyboard`;
      return button(label, () => this.selection.select(query, true), { disabled: query < 0, title });
    };
    return make(
      "div",
      { class: "steps" },
      step("\u2039 Previous", -1, "p"),
      make("span", { class: "muted" }, this.table.position()),
      step("Next \u203a", 1, "n"),
      button("Close", () => this.selection.select(-1), { title: "Esc on the keyboard" }),
    );
  }

  private header(query: number): HTMLElement {
    const { summary, queries } = this.data;
    const status = summary.statuses[queries.status[query]].name;
    const title = make("h2", { title: queries.names[query] }, visibleText(queries.names[query]));
    const badge = make(
      "span",
      { class: "badge", title: status },
      statusMark(summary, queries, query),
      statusLabel(status),
    );
    return make("div", { class: "query-head" }, title, badge, this.steps());
  }

  private reason(query: number): HTMLElement[] {
    const reason = this.data.queries.reasons[query];
    if (reason === "") return [];
    const sentence = visibleText(reason[0].toUpperCase() + reason.slice(1));
    return [make("p", { class: "callout" }, /[.!?]$/.test(sentence) ? sentence : `${sentence}.`)];
  }

  // Returns the few numbers that matter most, large.
  private figures(query: number): HTMLElement {
    const { summary, queries } = this.data;
    const length = (value: number) => format.formatLength(value, summary);
    const numbers: [label: string, text: string, explanation: string][] = [
      ["Confidence", format.formatConfidence(queries.confidence[query]), EXPLANATIONS.confidence],
    ];
    if (summary.hasTruth) {
      numbers.push(["Position error", length(queries.positionError[query]), EXPLANATIONS.positionError]);
      const degrees = format.formatDegrees(queries.rotationErrorDeg[query]);
      numbers.push(["Orientation error", degrees, EXPLANATIONS.rotationError]);
    }
    numbers.push(
      ["Position, std. dev.", length(queries.positionStddev[query]), EXPLANATIONS.positionStddev],
      ["Orientation, std. dev.", format.formatDegrees(queries.rotationStddevDeg[query]), EXPLANATIONS.rotationStddev],
      ["Points", format.formatCount(queries.numTracks[query]), EXPLANATIONS.tracks],
      ["Reprojection error", format.formatPixels(queries.reprojectionErrorPx[query]), EXPLANATIONS.reprojection],
      ["Images used", format.formatCount(queries.numImages[query]), EXPLANATIONS.images],
    );
    const known = numbers.filter(([, text]) => text !== format.UNKNOWN && text !== "0");
    const items = known.map(([label, text, explanation]) =>
      make("div", {}, make("dt", {}, label, help(explanation)), make("dd", {}, text)),
    );
    return make("dl", { class: "figures" }, ...items);
  }

  // Returns where the query is, in each system of coordinates.
  private positions(query: number): HTMLElement {
    const { queries } = this.data;
    const items = queries.systems.map((system, i) => {
      const texts = positionTexts(queries, query, i);
      if (!texts) return null;
      const value = make("code", { class: "position" }, texts.join(", "));
      const copy = copyButton("Copy", () => texts.join(", "), { title: `Copy ${system.axes.join(", ")}` });
      return make("div", {}, make("dt", {}, `${system.name}: ${axesText(system)}`), make("dd", {}, value, copy));
    });
    return make("dl", { class: "figures positions" }, ...items);
  }

  private async fill(body: HTMLElement, query: number, numShown: number): Promise<void> {
    const isDrawn = this.data.queries.isDrawn[query] === 1;
    const [{ details, row }, drawing] = await Promise.all([loadDetails(query), isDrawn ? loadDrawing(query) : null]);
    if (numShown !== this.numShown) return;
    const { scene, queries } = this.data;
    const left = make("div", { class: "query-left" });
    let highlight = (_: number) => {};
    if (drawing) {
      const figure = makeFigure(drawing, queries.names[query], queries.photo[query], scene);
      left.append(figure.element);
      highlight = (image) => figure.highlight(drawing.images.findIndex((other) => other.image === image));
      if (queries.photo[query] < 0) left.append(make("p", { class: "muted" }, NO_PHOTO));
    } else if (hasPairs(details, row)) left.append(make("p", { class: "muted" }, NO_DRAWING));
    left.append(facts(details, row));
    const pairs = pairTable(details, row, scene, highlight);
    const right = make("div", { class: "query-right" }, pairs, timeBar(details, row), command(details.commands[row]));
    body.replaceChildren(left, right);
  }
}

function hasPairs(details: Details, row: number): boolean {
  return details.pairOffsets[row + 1] > details.pairOffsets[row];
}

const NO_PHOTO = "The photo is not in this report, so the frame of the image is drawn in its place.";
const NO_DRAWING =
  "This query's matches are not drawn: either no database was given to the report, or it was not among the queries chosen for drawing.";

function facts(details: Details, row: number): HTMLElement {
  const list = make("dl", { class: "facts" });
  for (const [label, text] of details.facts[row]) {
    if (HEAD_FACTS.has(label)) continue;
    list.append(make("div", {}, make("dt", {}, label), make("dd", {}, visibleText(text))));
  }
  return make("section", {}, make("h3", {}, "What is known"), list);
}

function command(text: string): HTMLElement | null {
  if (!text) return null;
  const code = make("pre", { tabindex: 0 }, text);
  const copy = copyButton("Copy", () => text);
  return make("section", { class: "command" }, make("h3", {}, "Repeat this query alone", copy), code);
}
