// Loads chunks and photos: from elements of the page, or, if the report was written with --split, from files beside it.
import { unpack } from "./chunk";
import { DETAILS_PER_BLOCK, type Details, type Drawing, type Queries, type Scene, type Summary } from "./data";

interface Chunks {
  summary: Summary;
  queries: Queries;
  scene: Scene;
}

const isSplit = document.documentElement.hasAttribute("data-split");
const arrived = new Map<string, string>(); // of a split report: base64 by name of the chunk
const cache = new Map<string, Promise<unknown>>();
const MAX_NUM_CACHED = 40;

// Takes what a file chunks/NAME.js of a split report hands over.
export function addChunk(name: string, base64: string): void {
  arrived.set(name, base64);
}

function loadScript(name: string): Promise<string> {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = `chunks/${name}.js`;
    script.onload = () => {
      const base64 = arrived.get(name);
      arrived.delete(name);
      script.remove();
      if (base64 === undefined) reject(new Error(`The file chunks/${name}.js holds something else.`));
      else resolve(base64);
    };
    script.onerror = () => reject(new Error(`The file chunks/${name}.js is missing.`));
    document.head.append(script);
  });
}

async function base64Of(name: string): Promise<string> {
  if (isSplit) return loadScript(name);
  const element = document.querySelector(`script[data-chunk="${name}"]`);
  if (!element) throw new Error(`The part "${name}" of this page is missing.`);
  return element.textContent ?? "";
}

async function loadNow(name: string): Promise<unknown> {
  const base64 = await base64Of(name);
  try {
    return await unpack(base64);
  } catch (error) {
    if (error instanceof Error && error.message.startsWith("This browser")) throw error;
    throw new Error(`The part "${name}" of this page is damaged; write the report again.`);
  }
}

function load<T>(name: string): Promise<T> {
  let chunk = cache.get(name);
  if (!chunk) {
    chunk = loadNow(name);
    chunk.catch(() => cache.delete(name));
    cache.set(name, chunk);
    if (cache.size > MAX_NUM_CACHED) cache.delete([...cache.keys()][0]);
  }
  return chunk as Promise<T>;
}

// Sums up the differences between indices, modulo 2^32.
function indicesFromDeltas(deltas: Uint32Array): Uint32Array {
  const indices = new Uint32Array(deltas.length);
  let index = 0;
  for (let i = 0; i < deltas.length; i++) indices[i] = index = (index + deltas[i]) >>> 0;
  return indices;
}

async function loadScene(): Promise<Scene> {
  const { pointDeltas, ...scene } = await load<Scene & { pointDeltas: Uint32Array }>("scene");
  return { ...scene, pointIndices: indicesFromDeltas(pointDeltas) };
}

export async function loadChunks(): Promise<Chunks> {
  const [summary, queries, scene] = await Promise.all([
    load<Summary>("summary"),
    load<Queries>("queries"),
    loadScene(),
  ]);
  for (const name of ["summary", "queries", "scene"]) cache.delete(name);
  return { summary, queries, scene };
}

// Returns what the query page shows in words, and the row of this query in it.
export async function loadDetails(query: number): Promise<{ details: Details; row: number }> {
  const details = await load<Details>(`details/${Math.floor(query / DETAILS_PER_BLOCK)}`);
  return { details, row: query % DETAILS_PER_BLOCK };
}

export function loadDrawing(query: number): Promise<Drawing> {
  return load<Drawing>(`drawing/${query}`);
}

// Returns an address for <img src>, or null if the page has no such photo.
export function photoUrl(photo: number): string | null {
  if (photo < 0) return null;
  if (isSplit) return `photos/${photo}.jpg`;
  const element = document.querySelector(`script[data-photo="${photo}"]`);
  return element ? `data:image/jpeg;base64,${(element.textContent ?? "").trim()}` : null;
}
