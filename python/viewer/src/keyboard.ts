// Handles the keys that work anywhere on the page.
import type { Selection } from "./selection";
import type { Table } from "./table";

function isTyping(target: EventTarget | null): boolean {
  return (
    target instanceof HTMLInputElement || target instanceof HTMLSelectElement || target instanceof HTMLTextAreaElement
  );
}

export function watchKeys(selection: Selection, table: Table): void {
  const step = (offset: number) => {
    const query = table.neighbour(offset);
    if (query >= 0) selection.select(query, true);
  };
  const actions: Record<string, () => void> = {
    "/": () => table.filterField.focus(),
    Escape: () => selection.select(-1),
    n: () => step(1),
    p: () => step(-1),
  };
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    if (isTyping(event.target)) {
      if (event.key === "Escape" && event.target === table.filterField) table.focus();
      return;
    }
    const action = actions[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}
