// Makes elements; texts become text nodes, never HTML, because they may come from file names.

type Child = Node | string | null | undefined | false;
type Properties = Record<string, string | number | boolean | EventListener | null | undefined>;

function apply(element: Element, properties: Properties): void {
  for (const [name, value] of Object.entries(properties)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
}

// Returns an element; functions among the properties listen to the event of their name.
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  apply(element, properties);
  for (const child of children) if (child) element.append(child);
  return element;
}

export function makeSvg<K extends keyof SVGElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Child[]
): SVGElementTagNameMap[K] {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  apply(element, properties);
  for (const child of children) if (child) element.append(child);
  return element;
}

export function button(label: string, onClick: () => void, properties: Properties = {}): HTMLButtonElement {
  return make("button", { type: "button", class: "button", click: onClick, ...properties }, label);
}

// Returns a small question mark that explains a word when the pointer rests on it or the keyboard reaches it.
export function help(explanation: string): HTMLElement {
  const bubble = make("span", { class: "bubble", role: "tooltip" }, explanation);
  return make("span", { class: "help", tabindex: 0, role: "note", "aria-label": explanation }, "?", bubble);
}

// Returns a text whose line breaks and other control characters show: names of files may have them.
export function visibleText(text: string): string {
  return text
    .replace(/[\u0000-\u001f]/g, (c) => String.fromCharCode(0x2400 + c.charCodeAt(0)))
    .replace(/\u007f/g, "\u2421");
}

const NUM_LAST = 10; // characters of a name that are always shown: often its number and its ending

// Returns children for a name that is cut off in its middle where there is no room, because names differ at their ends.
export function nameParts(name: string): HTMLElement[] {
  const characters = [...name];
  const last = characters.length > 2 * NUM_LAST ? NUM_LAST : 0;
  const parts = [characters.slice(0, characters.length - last), characters.slice(characters.length - last)];
  return parts.filter((part) => part.length > 0).map((part) => make("bdi", {}, part.join("")));
}

export function reducedMotion(): boolean {
  return window.matchMedia("(prefers-reduced-motion: reduce)").matches;
}
