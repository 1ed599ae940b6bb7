// Holds the one selected query and mirrors it in the address, as #query/NAME, so that a link and Back lead to it.

const PREFIX = "#query/";

function hashOf(name: string): string {
  return PREFIX + name.split("/").map(encodeURIComponent).join("/");
}

// Returns the name of the query in an address, or null if it names none.
function nameIn(hash: string): string | null {
  if (!hash.startsWith(PREFIX)) return null;
  try {
    return hash.slice(PREFIX.length).split("/").map(decodeURIComponent).join("/");
  } catch {
    return hash.slice(PREFIX.length);
  }
}

export class Selection {
  // Holds the index of the selected query, or -1.
  query = -1;
  // Holds the name in the address if no query has it.
  unknownName: string | null = null;
  private readonly listeners: ((query: number) => void)[] = [];
  private readonly indices = new Map<string, number>();

  constructor(private readonly names: string[]) {
    for (let i = names.length - 1; i >= 0; i--) this.indices.set(names[i], i);
    window.addEventListener("hashchange", () => this.readAddress());
    window.addEventListener("popstate", () => this.readAddress());
  }

  // Selects a query, or none (-1), and tells the listeners if that is a change. A step, as of an arrow key, does not become
  // an entry of its own in the browser's history.
  select(query: number, isStep = false): void {
    if (query === this.query && this.unknownName === null) return;
    const hash = query < 0 ? "#" : hashOf(this.names[query]);
    try {
      if (isStep) history.replaceState(null, "", hash);
      else history.pushState(null, "", hash);
    } catch {
      location.hash = hash; // Serves browsers that forbid pushState in local files.
    }
    this.set(query, null);
  }

  onChange(listener: (query: number) => void): void {
    this.listeners.push(listener);
  }

  readAddress(): void {
    const name = nameIn(location.hash);
    const query = name === null ? -1 : (this.indices.get(name) ?? -1);
    this.set(query, name !== null && query < 0 ? name : null);
  }

  private set(query: number, unknownName: string | null): void {
    if (query === this.query && unknownName === this.unknownName) return;
    this.query = query;
    this.unknownName = unknownName;
    for (const listener of this.listeners) listener(query);
  }
}
