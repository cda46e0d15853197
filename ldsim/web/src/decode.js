// From reduced coordinates to positions and normals on the GPU: the basis lies in a texture, results in two others.

import { Program, target, texture } from "./gl.js";
import normalsShader from "./shaders/normals.frag.glsl";
import positionsShader from "./shaders/positions.frag.glsl";
import screenShader from "./shaders/screen.vert.glsl";

const WIDTH = 2048;

/** A float texture of `count` texels, of which `fill(texel, data, at)` writes the four numbers. */
function table(gl, count, fill) {
  const height = Math.max(1, Math.ceil(count / WIDTH)), data = new Float32Array(4 * WIDTH * height);
  for (let i = 0; i < count; i++) fill(i, data, 4 * i);
  return texture(gl, gl.RGBA32F, WIDTH, height, data);
}

/** Around every copy of a vertex, the other two corners of each of its triangles; where its own begin and end; which it is. */
function fans({ copies, corners, triangles }) {
  const around = Array.from(copies, () => []);
  corners.forEach((copy, i) => {
    const t = 3 * Math.floor(i / 3);
    around[copy].push([triangles[t + ((i + 1) % 3)], triangles[t + ((i + 2) % 3)]]);
  });
  let begin = 0;
  return { pairs: around.flat(), ranges: around.map((own, i) => [begin, (begin += own.length), copies[i]]) };
}

export class GpuDecoder {
  /** basis: (v, 3, k) of the surface's vertices. Needs EXT_color_buffer_float. */
  constructor(gl, surface, basis, k) {
    const { count, rest, copies } = surface, { pairs, ranges } = fans(surface);
    this.gl = gl;
    this.k = k;
    this.qTexture = table(gl, k, () => {});
    this.q = new Float32Array(4 * WIDTH);
    this.positions = this.pass(positionsShader, count, {
      rest: table(gl, count, (i, data, at) => data.set(rest.subarray(3 * i, 3 * i + 3), at)),
      basis: table(gl, count * k, (n, data, at) => {
        const row = 3 * Math.floor(n / k) * k + (n % k);
        data.set([basis[row], basis[row + k], basis[row + 2 * k]], at);
      }),
      q: this.qTexture,
      columns: k,
    });
    this.normals = this.pass(normalsShader, copies.length, {
      positions: this.positions.texture,
      pairs: table(gl, pairs.length, (i, data, at) => data.set(pairs[i], at)),
      ranges: table(gl, copies.length, (i, data, at) => data.set(ranges[i], at)),
    });
  }

  pass(shader, count, values) {
    const { gl } = this, width = Math.ceil(Math.sqrt(count)), height = Math.ceil(count / width);
    const into = texture(gl, gl.RGBA32F, width, height);
    const frame = target(gl, gl.COLOR_ATTACHMENT0, into);
    return { program: new Program(gl, screenShader, shader), values: { ...values, width, count }, texture: into, frame, width, height };
  }

  decode(q) {
    const { gl } = this;
    for (let j = 0; j < q.length; j++) this.q[4 * j] = q[j];
    gl.bindTexture(gl.TEXTURE_2D, this.qTexture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, 1, gl.RGBA, gl.FLOAT, this.q);
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    for (const { program, values, frame, width, height } of [this.positions, this.normals]) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.viewport(0, 0, width, height);
      program.use(values);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Frees what it has on the graphics card, which a garbage collector may leave there for long. */
  dispose() {
    const { gl } = this;
    for (const { program, values, texture, frame } of [this.positions, this.normals]) {
      gl.deleteProgram(program.program);
      gl.deleteFramebuffer(frame);
      for (const each of [texture, ...Object.values(values)]) if (each instanceof WebGLTexture) gl.deleteTexture(each);
    }
  }

  /** The positions as the GPU has them, (3v); slow, for tests. */
  read(count) {
    const { gl } = this, { width, height, frame } = this.positions, texels = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, texels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return Float32Array.from({ length: 3 * count }, (_, i) => texels[4 * Math.floor(i / 3) + (i % 3)]);
  }
}
