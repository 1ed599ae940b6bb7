// Starts the report page: loads its data and builds what it shows.
import { addChunk, loadChunks } from "./load";
import { Selection } from "./selection";

async function start(root: HTMLElement): Promise<void> {
  const { summary, queries } = await loadChunks();
  const selection = new Selection(queries.names);
  const heading = document.createElement("h1");
  heading.textContent = `${summary.title}: ${summary.numQueries} queries`;
  root.append(heading);
  selection.readAddress();
}

Object.assign(window, { report: { addChunk } });
const root = document.getElementById("report");
if (root) {
  start(root).catch((error: unknown) => {
    root.textContent = error instanceof Error ? error.message : String(error);
  });
}
