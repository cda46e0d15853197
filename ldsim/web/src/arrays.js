// Numbers that come to a page: in base64 inside it, or in a block of the server.

const TYPES = {
  f4: Float32Array, u2: Uint16Array, i2: Int16Array, float32: Float32Array, uint32: Uint32Array,
};

export function decoded(base64) {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer;
}

/** An array as Python's `packed` gives it: its type and its bytes in base64. */
export const unpacked = ([type, base64]) => new TYPES[type](decoded(base64));

/** The bytes that Python's `compressed` was given (ldsim/export/playground.py). */
export async function inflated(base64) {
  const stream = new Blob([decoded(base64)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const apart = new Uint8Array(await new Response(stream).arrayBuffer()), words = Math.floor(apart.length / 4);
  const bytes = apart.slice(); // the last ones, of no whole word, are where they were
  for (let i = 0; i < words; i++) for (let j = 0; j < 4; j++) bytes[4 * i + j] = apart[words * j + i];
  return bytes;
}

const json = (buffer, start, length) => JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, start, length)));

/** A block of the server (ldsim/viewer/payload.py): its header with every array under its name. */
export async function fetchBlock(name) {
  const response = await fetch(name, { cache: "no-store" });
  if (!response.ok) throw new Error(`${name}: ${response.status}`);
  const buffer = await response.arrayBuffer(), length = new DataView(buffer).getUint32(0, true);
  const block = json(buffer, 4, length);
  let offset = 4 + length;
  for (const { name, type, shape } of block.arrays) {
    block[name] = new TYPES[type](buffer, offset, shape.reduce((a, b) => a * b, 1));
    offset += block[name].byteLength;
  }
  return block;
}
