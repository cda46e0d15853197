// The C library of ldsim/runtime as WebAssembly: a model that is loaded, and a solid that steps it.

const VECTOR = 0, RECORD = 32, ID = 64, SCRATCH = 72; // places in the scratch memory of a solid, and its bytes

/** The library from the bytes of ldsim.wasm. */
export const runtimeOf = async (bytes) => new Runtime((await WebAssembly.instantiate(bytes)).instance.exports);

export class Runtime {
  constructor(library) {
    this.library = library;
    library._initialize();
  }

  /** Numbers of the library's memory; the view is of no use after the next allocation. */
  view = (Type, at, count) => new Type(this.library.memory.buffer, at >>> 0, count); // beyond 2 GiB numbers are negative

  /** Hands numbers over; who asks for it frees it. */
  put(values) {
    const at = this.library.malloc(values.byteLength || 1);
    if (!at) throw new Error("there is not enough memory");
    this.view(values.constructor, at, values.length).set(values);
    return at;
  }

  /** The `count` numbers that a function of the library leaves where it is told. */
  filled(Type, count, call) {
    const at = this.put(new Type(count));
    try {
      call(at);
      return this.view(Type, at, count).slice();
    } finally {
      this.library.free(at);
    }
  }

  check(code) {
    if (!code) return;
    const text = this.view(Uint8Array, this.library.ldsim_message(code));
    throw new Error(new TextDecoder().decode(text.slice(0, text.indexOf(0))));
  }
}

export class Model {
  /** bytes: of model.ldsim. */
  constructor(runtime, bytes) {
    const { library } = (this.runtime = runtime), at = runtime.put(bytes);
    let code;
    [this.pointer] = runtime.filled(Uint32Array, 1, (out) => (code = library.ldsim_load(at, bytes.length, out)));
    library.free(at);
    runtime.check(code);
    const info = runtime.filled(Float64Array, 11, (out) => library.ldsim_describe(this.pointer, out));
    const [vertices, triangles, r, features, points] = new Uint32Array(info.buffer);
    Object.assign(this, { vertices, r, features, points, timeStep: info[4], gravity: Array.from(info.slice(5, 8)) });
    const copied = (Type, name, count) => runtime.view(Type, library[`ldsim_${name}`](this.pointer), count).slice();
    this.rest = copied(Float64Array, "rest", 3 * vertices);
    this.triangles = copied(Uint32Array, "triangles", 3 * triangles);
    this.movable = copied(Uint32Array, "movable", vertices);
  }

  /** What each feature moves some vertices, (v, 3, features). */
  fields(vertices) {
    const { runtime, pointer } = this, at = runtime.put(Uint32Array.from(vertices)), count = 3 * vertices.length;
    try {
      return runtime.filled(Float32Array, count * this.features, (out) =>
        runtime.check(runtime.library.ldsim_fields(pointer, at, vertices.length, out)),
      );
    } finally {
      runtime.library.free(at);
    }
  }

  /** Gives its memory back, after all of its solids are destroyed; then it is of no use. A second time does nothing. */
  destroy() {
    if (this.pointer) this.runtime.library.ldsim_free(this.pointer);
    this.pointer = this.runtime = null;
  }

  /** The movable vertices within `radius` of the one nearest to a point at rest: `held_vertices` in Python. */
  held(point, radius) {
    const { rest, movable } = this, apart = (v, x) => Math.hypot(...x.map((xi, i) => rest[3 * v + i] - xi));
    let picked = 0;
    for (let v = 1; v < movable.length; v++) if (apart(v, point) < apart(picked, point)) picked = v;
    const centre = Array.from(rest.slice(3 * picked, 3 * picked + 3));
    return Array.from(movable.keys()).filter((v) => movable[v] && apart(v, centre) <= radius);
  }
}

/** A solid at rest; what its methods do stands in ldsim.h. */
export class Solid {
  constructor(model, grabs = 16) {
    const { library } = (this.runtime = model.runtime);
    Object.assign(this, { model, library, scratch: this.runtime.put(new Uint8Array(SCRATCH)) });
    const code = library.ldsim_create(model.pointer, grabs, this.scratch);
    if (code) library.free(this.scratch);
    this.runtime.check(code);
    [this.pointer] = this.runtime.view(Uint32Array, this.scratch, 1);
  }

  /** Gives its memory back; then it is of no use: whatever is called throws. A second time does nothing. */
  destroy() {
    this.library?.ldsim_destroy(this.pointer);
    this.library?.free(this.scratch);
    this.library = this.runtime = null; // address 0 is memory like any other: without this, calls would write there
  }

  vector(values) {
    this.runtime.view(Float64Array, this.scratch + VECTOR, 3).set(values);
    return this.scratch + VECTOR;
  }

  step() {
    const at = this.scratch + RECORD, outcome = this.library.ldsim_step(this.pointer, at);
    const [iterations, evaluations, reason] = this.runtime.view(Int32Array, at, 3);
    return { iterations, evaluations, reason, outcome };
  }

  /** A number that names the grab from now on. */
  grab(vertices, target, stiffness) {
    const at = this.runtime.put(Uint32Array.from(vertices)), id = this.scratch + ID;
    const code = this.library.ldsim_grab_vertices(this.pointer, at, vertices.length, this.vector(target), stiffness, id);
    this.library.free(at);
    this.runtime.check(code);
    return this.runtime.view(Uint32Array, id, 1)[0];
  }

  move = (grab, target) => this.runtime.check(this.library.ldsim_move(this.pointer, grab, this.vector(target)));
  release = (grab) => this.runtime.check(this.library.ldsim_release(this.pointer, grab));
  reset = () => this.library.ldsim_reset(this.pointer);

  /** The state with its grabs, as bytes to come back to. */
  save() {
    const size = this.library.ldsim_state_size(this.pointer);
    return this.runtime.filled(Uint8Array, size, (out) => this.library.ldsim_save(this.pointer, out));
  }

  restore(state) {
    const at = this.runtime.put(state), code = this.library.ldsim_restore(this.pointer, at, state.length);
    this.library.free(at);
    this.runtime.check(code);
  }

  setGravity = (gravity) => this.runtime.check(this.library.ldsim_set_gravity(this.pointer, this.vector(gravity)));
  setStiffness = (scale) => this.runtime.check(this.library.ldsim_set_stiffness(this.pointer, scale));

  /** Where the middle of what is held is now. */
  centroid(grab) {
    this.runtime.check(this.library.ldsim_centroid(this.pointer, grab, this.scratch + VECTOR));
    return Array.from(this.runtime.view(Float64Array, this.scratch + VECTOR, 3));
  }

  /** The numbers that displacements are linear in. */
  get features() {
    return this.runtime.view(Float64Array, this.library.ldsim_features(this.pointer), this.model.features).slice();
  }

  get novelty() {
    return this.library.ldsim_novelty(this.pointer);
  }
}
