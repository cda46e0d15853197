// Vectors of three numbers, and of any number where it says so.

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** a + s b. */
export const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];

export const minus = (a, b) => along(a, -1, b);

export const length = (a) => Math.hypot(a[0], a[1], a[2]);

export const normalised = (a) => along([0, 0, 0], 1 / (length(a) || 1), a);

/** Number i of a list of vectors, three numbers each. */
export const at = (list, i) => [list[3 * i], list[3 * i + 1], list[3 * i + 2]];

/** The corners of the box around a list of vectors. */
export function box(list) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < list.length; i++) {
    low[i % 3] = Math.min(low[i % 3], list[i]);
    high[i % 3] = Math.max(high[i % 3], list[i]);
  }
  return { low, high, diagonal: length(minus(high, low)), centre: low.map((x, i) => (x + high[i]) / 2) };
}
