// Unpacks the chunks that python/colmap_lazyloc/report/chunk.py packs.

const TYPES = {
  u8: Uint8Array,
  u16: Uint16Array,
  u32: Uint32Array,
  i32: Int32Array,
  f32: Float32Array,
  f64: Float64Array,
};
type Header = { values: Record<string, unknown>; arrays: Record<string, [keyof typeof TYPES, number, number]> };

function bytesFromBase64(text: string): Uint8Array<ArrayBuffer> {
  const { fromBase64 } = Uint8Array as unknown as { fromBase64?: (text: string) => Uint8Array<ArrayBuffer> };
  if (fromBase64) return fromBase64.call(Uint8Array, text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function gunzip(bytes: Uint8Array<ArrayBuffer>): Promise<ArrayBuffer> {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("This browser is too old for the report: it needs Firefox 113, Chromium 111, Safari 16.4 or newer.");
  }
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

// Returns the values and the arrays of a chunk as one object; throws if the bytes are damaged.
export async function unpack(base64: string): Promise<Record<string, unknown>> {
  const buffer = await gunzip(bytesFromBase64(base64));
  const headerSize = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, headerSize))) as Header;
  const chunk: Record<string, unknown> = { ...header.values };
  for (const [name, [kind, offset, length]] of Object.entries(header.arrays)) {
    chunk[name] = new TYPES[kind](buffer, 4 + headerSize + offset, length);
  }
  return chunk;
}
