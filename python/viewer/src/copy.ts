// Makes buttons that copy a text.
import { button, make } from "./dom";

const SHOWN_MILLISECONDS = 2000;

// Returns a button that copies what `text` returns, and says so.
export function copyButton(label: string, text: () => string, properties: Record<string, string> = {}): HTMLButtonElement {
  const element = button(
    label,
    () => {
      void copy(text()).then((isCopied) => {
        element.textContent = isCopied ? "Copied" : "The browser refuses: select the text";
        setTimeout(() => (element.textContent = label), SHOWN_MILLISECONDS);
      });
    },
    properties,
  );
  return element;
}

// Copies a text; returns false if the browser forbids that.
async function copy(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return copyBySelection(text);
  }
}

// Copies in browsers that lend the clipboard only to pages from a server.
function copyBySelection(text: string): boolean {
  const field = make("textarea", { class: "clipboard", "aria-hidden": "true", tabindex: -1 });
  field.value = text;
  document.body.append(field);
  field.select();
  const isCopied = document.execCommand("copy");
  field.remove();
  return isCopied;
}
