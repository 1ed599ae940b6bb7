// Shows the queries in a table that makes only the rows in view, so that 100,000 queries scroll smoothly.
import { queryColor, statusLabel } from "./colors";
import { type Column, tableColumns } from "./columns";
import type { Queries, Summary } from "./data";
import { button, make, nameParts } from "./dom";
import { formatCount } from "./format";
import { sortedIndices } from "./sort";
import type { Selection } from "./selection";

const ROW_HEIGHT = 28;
const NUM_SPARE_ROWS = 8;
const NUM_PRINTED_ROWS = 40;

export type StatusFilter = Set<number>; // indices of Summary.statuses; empty: all

export interface TableEvents {
  onFilter(visible: Uint8Array, numVisible: number): void; // visible: 1 a query that the filter leaves
  onSort(): void;
  onOpen(): void; // the user asked for the page of the selected query
}

export class Table {
  readonly element: HTMLElement;
  readonly filterField: HTMLInputElement;
  private readonly columns: Column[];
  private readonly keys: Float32Array[] = [];
  private readonly grid: HTMLElement;
  private readonly body: HTMLElement;
  private readonly headers: HTMLElement[];
  private readonly count = make("span", { class: "count", role: "status" });
  private readonly empty = make("p", { class: "empty", hidden: true }, "No query matches the filter.");
  private searchTexts: string[] | null = null;
  private order: Uint32Array; // the shown queries, in the order of the rows
  private readonly rowOf: Int32Array; // of each query, or -1
  private readonly visible: Uint8Array; // 1 a query that the filter leaves
  private sorted: Uint32Array; // all queries in that order
  private sortColumn = -1;
  private isDescending = false;
  private isPrinted = false;
  private statuses: StatusFilter = new Set();
  private rows = new Map<number, HTMLElement>();

  constructor(
    private readonly summary: Summary,
    private readonly queries: Queries,
    private readonly selection: Selection,
    private readonly events: TableEvents,
  ) {
    this.columns = tableColumns(queries, summary);
    this.sorted = Uint32Array.from(queries.names, (_, i) => i);
    this.order = this.sorted;
    this.rowOf = Int32Array.from(this.sorted);
    this.visible = new Uint8Array(this.sorted.length);
    this.headers = this.columns.map((column, i) => this.makeHeader(column, i));
    this.body = make("div", { class: "rows", role: "rowgroup" });
    this.grid = this.makeGrid();
    this.filterField = make("input", {
      type: "search",
      class: "field",
      placeholder: "Filter by name, status or reason",
      "aria-label": "Filter the queries",
      title: "Press / to come here",
      input: () => this.filter(),
    });
    const bar = make("div", { class: "bar" }, this.filterField, this.count);
    this.element = make("section", { class: "panel table-panel", "aria-label": "Queries" }, bar, this.grid, this.empty);
    this.watch();
    this.filter();
  }

  // Shows only queries of these statuses.
  setStatuses(statuses: StatusFilter): void {
    this.statuses = statuses;
    this.filter();
  }

  // Returns the shown query before (-1) or after (1) the selected one, or -1.
  neighbour(step: number): number {
    const row = this.selection.query < 0 ? -1 : this.rowOf[this.selection.query];
    const next = row < 0 ? (step > 0 ? 0 : this.order.length - 1) : row + step;
    return next >= 0 && next < this.order.length ? this.order[next] : -1;
  }

  position(): string {
    const row = this.selection.query < 0 ? -1 : this.rowOf[this.selection.query];
    return row < 0 ? "" : `${formatCount(row + 1)} of ${formatCount(this.order.length)}`;
  }

  // Returns the shown queries, in the order of the rows.
  shown(): Uint32Array {
    return this.order;
  }

  // Adds a button to the bar above the table.
  addControl(element: HTMLElement): void {
    this.count.after(element);
  }

  focus(): void {
    this.grid.focus();
  }

  // Draws the rows again, because colours changed.
  refresh(): void {
    for (const row of this.rows.values()) row.remove();
    this.rows.clear();
    this.draw();
  }

  private makeHeader(column: Column, i: number): HTMLElement {
    const sort = button(column.label, () => this.sortBy(i), { class: "sort", title: column.explanation });
    return make("div", { class: `cell ${column.kind}`, role: "columnheader", "aria-sort": "none" }, sort);
  }

  private makeGrid(): HTMLElement {
    const head = make("div", { class: "row header", role: "row", "aria-rowindex": 1 }, ...this.headers);
    const grid = make(
      "div",
      { class: "grid", role: "grid", tabindex: 0, "aria-label": "Queries", "aria-colcount": this.columns.length },
      make("div", { class: "rowgroup", role: "rowgroup" }, head),
      this.body,
    );
    // On a phone, a name leaves room for the position.
    const widths = this.columns.map(({ width }, i) => (i === 0 ? `min(${width}rem, 34vw)` : `${width}rem`));
    const ranges = this.columns.map(({ growth }, i) => `minmax(${widths[i]}, ${growth ? `${growth}fr` : widths[i]})`);
    grid.style.setProperty("--columns", ranges.join(" "));
    grid.style.setProperty("--width", `calc(${widths.join(" + ")})`);
    return grid;
  }

  private watch(): void {
    this.grid.addEventListener("scroll", () => this.draw(), { passive: true });
    this.grid.addEventListener("keydown", (event) => this.onKey(event));
    this.body.addEventListener("click", (event) => this.selection.select(this.queryAt(event)));
    this.body.addEventListener("dblclick", () => this.events.onOpen());
    new ResizeObserver(() => this.draw()).observe(this.grid);
    this.selection.onChange(() => this.showSelected());
    window.addEventListener("beforeprint", () => this.setPrinted(true));
    window.addEventListener("afterprint", () => this.setPrinted(false));
  }

  private setPrinted(isPrinted: boolean): void {
    this.isPrinted = isPrinted;
    this.refresh();
  }

  private queryAt(event: Event): number {
    const row = event.target instanceof Element ? event.target.closest<HTMLElement>("[data-query]") : null;
    return row ? Number(row.dataset.query) : this.selection.query;
  }

  private onKey(event: KeyboardEvent): void {
    if (event.target !== this.grid || event.ctrlKey || event.metaKey || event.altKey) return;
    const page = Math.max(1, Math.floor(this.grid.clientHeight / ROW_HEIGHT) - 2);
    const last = this.order.length - 1;
    const row = this.selection.query < 0 ? -1 : this.rowOf[this.selection.query];
    const targets: Record<string, number> = {
      ArrowDown: row + 1,
      ArrowUp: row < 0 ? last : row - 1,
      PageDown: row + page,
      PageUp: row - page,
      Home: 0,
      End: last,
    };
    if (event.key === "Enter" && row >= 0) this.events.onOpen();
    else if (event.key in targets && last >= 0) {
      this.selection.select(this.order[Math.max(0, Math.min(last, targets[event.key]))], true);
    } else return;
    event.preventDefault();
  }

  private sortBy(column: number): void {
    const isSame = column === this.sortColumn;
    this.isDescending = isSame ? !this.isDescending : !this.columns[column].isWorstLow;
    this.sortColumn = column;
    this.headers.forEach((header, i) => {
      const direction = this.isDescending ? "descending" : "ascending";
      header.setAttribute("aria-sort", i === column ? direction : "none");
    });
    this.sorted = sortedIndices(this.keysOf(column), this.isDescending);
    this.arrange();
    this.grid.scrollTop = 0;
    this.events.onSort();
  }

  private keysOf(column: number): Float32Array {
    this.keys[column] ??= this.computeKeys(column);
    return this.keys[column];
  }

  private computeKeys(column: number): Float32Array {
    const keys = new Float32Array(this.queries.names.length);
    for (let query = 0; query < keys.length; query++) keys[query] = this.columns[column].key(query);
    return keys;
  }

  private filter(): void {
    const wanted = this.filterField.value.trim().toLowerCase();
    this.searchTexts ??= this.queries.names.map((name, i) => `${name}\n${this.queries.reasons[i]}`.toLowerCase());
    const texts = this.searchTexts;
    const isLabelled = this.summary.statuses.map(({ name }) =>
      `${name}\n${statusLabel(name)}`.toLowerCase().includes(wanted),
    );
    this.queries.status.forEach((status, query) => {
      const isShown =
        (this.statuses.size === 0 || this.statuses.has(status)) &&
        (isLabelled[status] || texts[query].includes(wanted));
      this.visible[query] = isShown ? 1 : 0;
    });
    this.arrange();
    this.events.onFilter(this.visible.slice(), this.order.length);
  }

  // Puts the queries that the filter leaves into the rows.
  private arrange(): void {
    this.order = this.sorted.filter((query) => this.visible[query] === 1);
    this.rowOf.fill(-1);
    for (let row = 0; row < this.order.length; row++) this.rowOf[this.order[row]] = row;
    this.showCount();
    this.refresh();
  }

  private showCount(): void {
    const num = this.order.length;
    const all = this.queries.names.length;
    this.count.textContent =
      num === all ? `${formatCount(all)} queries` : `${formatCount(num)} of ${formatCount(all)} queries`;
    this.empty.hidden = num > 0;
    this.grid.setAttribute("aria-rowcount", String(num + 1));
    this.body.style.height = `${num * ROW_HEIGHT}px`;
  }

  private showSelected(): void {
    const row = this.selection.query < 0 ? -1 : this.rowOf[this.selection.query];
    if (row >= 0) {
      const visible = this.grid.clientHeight - ROW_HEIGHT - 4; // without the header
      const top = row * ROW_HEIGHT;
      if (top < this.grid.scrollTop) this.grid.scrollTop = top;
      else if (top + ROW_HEIGHT > this.grid.scrollTop + visible) this.grid.scrollTop = top + ROW_HEIGHT - visible;
    }
    this.refresh();
  }

  private draw(): void {
    const first = this.isPrinted ? 0 : Math.max(0, Math.floor(this.grid.scrollTop / ROW_HEIGHT) - NUM_SPARE_ROWS);
    const height = this.isPrinted
      ? NUM_PRINTED_ROWS
      : Math.ceil(this.grid.clientHeight / ROW_HEIGHT) + 2 * NUM_SPARE_ROWS;
    const end = Math.min(this.order.length, first + height);
    for (const [row, element] of this.rows) {
      if (row >= first && row < end) continue;
      element.remove();
      this.rows.delete(row);
    }
    for (let row = first; row < end; row++) {
      if (this.rows.has(row)) continue;
      const element = this.makeRow(row);
      this.rows.set(row, element);
      this.body.append(element);
    }
    const row = this.selection.query < 0 ? -1 : this.rowOf[this.selection.query];
    if (this.rows.has(row)) this.grid.setAttribute("aria-activedescendant", `row-${row}`);
    else this.grid.removeAttribute("aria-activedescendant");
  }

  private makeRow(row: number): HTMLElement {
    const query = this.order[row];
    const isSelected = query === this.selection.query;
    const cells = this.columns.map((column) => this.makeCell(column, query));
    const element = make(
      "div",
      {
        class: "row",
        role: "row",
        id: `row-${row}`,
        "aria-rowindex": row + 2,
        "aria-selected": String(isSelected),
        "data-query": query,
      },
      ...cells,
    );
    element.style.top = `${row * ROW_HEIGHT}px`;
    return element;
  }

  private makeCell(column: Column, query: number): HTMLElement {
    const text = column.text(query);
    const cell = make("div", { class: `cell ${column.kind}`, role: "gridcell" });
    if (column.kind === "status") cell.append(statusMark(this.summary, this.queries, query));
    const confidence = this.queries.confidence[query];
    if (column.kind === "confidence" && !Number.isNaN(confidence)) cell.append(meter(confidence));
    if (column.id === "name") {
      cell.append(make("span", { class: "cut-name" }, ...nameParts(text)));
      cell.setAttribute("aria-label", text); // not in two parts
    } else cell.append(make("span", {}, text));
    if (column.kind === "text") cell.title = text;
    if (column.kind === "status") cell.title = this.queries.reasons[query];
    return cell;
  }
}

// Returns the sign of a status: its shape tells it apart without colours.
export function statusMark(summary: Summary, queries: Queries, query: number): HTMLElement {
  const mark = markOf(summary.statuses[queries.status[query]].name);
  mark.style.color = queryColor("status", queries, summary, query);
  return mark;
}

export function markOf(status: string): HTMLElement {
  const shapes: Record<string, string> = { LOCALIZED: "full", LOW_CONFIDENCE: "hollow", SCALE_UNOBSERVABLE: "line" };
  return make("span", { class: `mark ${shapes[status] ?? "cross"}`, "aria-hidden": "true" });
}

function meter(value: number): HTMLElement {
  const element = make("span", { class: "meter", "aria-hidden": "true" });
  element.style.setProperty("--value", String(value));
  return element;
}
