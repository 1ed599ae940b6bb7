// Shows what a user should look at first, with links to the queries.
import type { Summary, Warning } from "./data";
import { button, make, visibleText } from "./dom";
import { formatCount } from "./format";
import type { Selection } from "./selection";

const NUM_SHOWN = 3;
const MAX_NUM_OPEN = 2;

function list(warning: Warning, selection: Selection, onOpen: () => void): HTMLElement {
  const items = make("ul", { class: "items" });
  for (const { name, query, text } of warning.items) {
    const open = () => {
      selection.select(query);
      onOpen();
    };
    const label = visibleText(name);
    const head = query >= 0 ? button(label, open, { class: "button link" }) : make("span", { class: "name" }, label);
    items.append(make("li", {}, head, text ? ` ${text}` : null));
  }
  const numMissing = warning.numItems - warning.items.length;
  if (numMissing > 0) items.append(make("li", { class: "muted" }, `and ${formatCount(numMissing)} more`));
  if (items.children.length <= NUM_SHOWN + 1) return items;
  const rest = make("ul", { class: "items" }, ...[...items.children].slice(NUM_SHOWN));
  const more = make("details", {}, make("summary", {}, `${formatCount(warning.numItems - NUM_SHOWN)} more`), rest);
  return make("div", {}, items, more);
}

const CALM = "No database image contradicts the others, and no query is near the threshold of confidence.";

function calmHead({ statuses }: Summary): HTMLElement[] {
  const isLocalized = statuses.every(({ name }) => name === "LOCALIZED");
  const title = isLocalized ? "Nothing stands out" : "No warnings";
  const text = isLocalized ? CALM : `The table begins with the queries that are not localized. ${CALM}`;
  return [make("h2", {}, title), make("p", { class: "muted" }, text)];
}

// Returns a box with the warnings, and with notes on what the report lacks.
export function warningBox(summary: Summary, selection: Selection, onOpen: () => void): HTMLElement {
  const { warnings, notes } = summary;
  const box = make("section", { class: "card warnings", "aria-label": "Look at these first" });
  if (warnings.length === 0) box.append(...calmHead(summary));
  else box.append(make("h2", {}, "Look at these first"));
  warnings.forEach((warning, i) => {
    box.append(item(warning, i === 0 || warnings.length <= MAX_NUM_OPEN, selection, onOpen));
  });
  window.addEventListener("beforeprint", () => {
    for (const details of box.querySelectorAll("details")) details.open = true;
  });
  if (notes.length > 0) box.append(make("ul", { class: "notes" }, ...notes.map(noteItem)));
  return box;
}

// Returns a note in which the name of an option is not broken at its hyphens.
function noteItem(note: string): HTMLElement {
  const parts = note.split(/(--\w+)/);
  return make("li", {}, ...parts.map((part) => (part.startsWith("--") ? make("span", {}, part) : part)));
}

// Returns a warning that opens and closes; all but the first are closed if there are many, so that each is in sight.
function item(warning: Warning, isOpen: boolean, selection: Selection, onOpen: () => void): HTMLElement {
  const title = make("summary", {}, warning.title, make("span", { class: "number" }, formatCount(warning.numItems)));
  const explanation = make("p", { class: "muted" }, warning.explanation);
  return make("details", { class: "warning", open: isOpen }, title, explanation, list(warning, selection, onOpen));
}
