// Starts the report page: loads its data and builds what it shows.
import { positionTable } from "./coordinates";
import { copyButton } from "./copy";
import { button, make, nameParts, visibleText } from "./dom";
import { makeHead } from "./head";
import { watchKeys } from "./keyboard";
import { addChunk, loadChunks, loadDetails } from "./load";
import { QueryPage } from "./query_page";
import { Selection } from "./selection";
import { Table } from "./table";
import { ScenePanel } from "./workspace";

async function start(root: HTMLElement): Promise<void> {
  const { summary, queries, scene } = await loadChunks();
  const selection = new Selection(queries.names);
  const panel = new ScenePanel({ summary, queries, scene, loadDetails }, selection);
  let numVisible = 0;
  let page: QueryPage | null = null;
  const open = () => page?.open();
  const onFilter = (visible: Uint8Array, num: number) => {
    numVisible = num;
    panel.setVisible(visible);
    page?.updateSteps();
  };
  const table = new Table(summary, queries, selection, { onFilter, onSort: () => page?.updateSteps(), onOpen: open });
  page = new QueryPage({ summary, queries, scene }, selection, table);
  const head = makeHead(summary, queries, selection, {
    onFilter: (statuses) => table.setStatuses(statuses),
    onOpen: open,
  });
  const workspace = make("div", { class: "workspace" }, table.element, panel.element);
  const text = () => positionTable(queries, summary, table.shown());
  table.addControl(copyButton("Copy positions", text, { title: "Copy the positions of the queries below, for a spreadsheet" }));
  root.replaceChildren(head, make("main", {}, workspace, page.element), openBar(queries.names, selection, page));
  panel.open("webgl");
  const state = () => ({ selected: selection.query, numVisible, ...panel.view?.state() });
  const measure = (isCoarse: boolean) => panel.view?.measure(isCoarse);
  Object.assign(window, { report: { addChunk, state, measure, data: { summary, queries, scene } } });
  watchKeys(selection, table);
  selection.readAddress();
  await page.show();
  if (selection.query >= 0 || selection.unknownName !== null) page.element.scrollIntoView({ block: "start" });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    panel.refresh();
    table.refresh();
    void page.show();
  });
}

// Returns a bar at the bottom of the window that leads to the query page while that is out of sight.
function openBar(names: string[], selection: Selection, page: QueryPage): HTMLElement {
  const name = make("strong", { class: "cut-name" });
  const bar = make(
    "div",
    { class: "open-bar", hidden: true },
    name,
    button("Show photo, matches and evidence \u2193", () => page.open(), { class: "button primary" }),
    button("\u00d7", () => selection.select(-1), { "aria-label": "Clear the selection" }),
  );
  let isInSight = false;
  const update = () => {
    bar.hidden = isInSight || selection.query < 0;
    name.replaceChildren(...(selection.query < 0 ? [] : nameParts(visibleText(names[selection.query]))));
  };
  new IntersectionObserver(
    (entries) => {
      isInSight = entries[entries.length - 1].isIntersecting;
      update();
    },
    { rootMargin: "0px 0px -120px 0px" },
  ).observe(page.element);
  selection.onChange(update);
  return bar;
}

Object.assign(window, { report: { addChunk } });
const root = document.getElementById("report");
if (root) {
  root.replaceChildren(make("p", { class: "loading" }, "Opening the report\u2026"));
  start(root).catch((error: unknown) => {
    const text = error instanceof Error ? error.message : String(error);
    root.replaceChildren(make("p", { class: "callout fatal", role: "alert" }, `This report cannot be shown. ${text}`));
  });
}
