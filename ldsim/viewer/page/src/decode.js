// From reduced coordinates to positions and normals: on the GPU from the basis as a texture, or on the CPU.

import * as THREE from 'three';

const WIDTH = 2048;

/** rest + U q for every row of a basis (v, 3, k), into positions (3v). */
export function decodeOnCpu(rest, basis, k, q, positions) {
  for (let i = 0; i < positions.length; i++) {
    let total = rest[i];
    const row = i * k;
    for (let j = 0; j < k; j++) total += basis[row + j] * q[j];
    positions[i] = total;
  }
}

/** Area-weighted vertex normals of triangles at positions, into normals (3v). */
export function normalsOnCpu(positions, triangles, normals) {
  normals.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const [ux, uy, uz] = [positions[b] - positions[a], positions[b + 1] - positions[a + 1], positions[b + 2] - positions[a + 2]];
    const [vx, vy, vz] = [positions[c] - positions[a], positions[c + 1] - positions[a + 1], positions[c + 2] - positions[a + 2]];
    const [nx, ny, nz] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const at of [a, b, c]) {
      normals[at] += nx;
      normals[at + 1] += ny;
      normals[at + 2] += nz;
    }
  }
  for (let i = 0; i < normals.length; i += 3) {
    const length = Math.hypot(normals[i], normals[i + 1], normals[i + 2]) || 1;
    normals[i] /= length;
    normals[i + 1] /= length;
    normals[i + 2] /= length;
  }
}

/** A float texture of `count` texels with `channels` of the four filled by `fill(texel, data, at)`. */
function table(count, fill) {
  const height = Math.max(1, Math.ceil(count / WIDTH));
  const data = new Float32Array(4 * WIDTH * height);
  for (let i = 0; i < count; i++) fill(i, data, 4 * i);
  const texture = new THREE.DataTexture(data, WIDTH, height, THREE.RGBAFormat, THREE.FloatType);
  texture.needsUpdate = true;
  return texture;
}

/** Around every vertex, the other two corners of each of its triangles; and where each vertex's begin. */
function fans(count, triangles) {
  const around = Array.from({ length: count }, () => []);
  for (let t = 0; t < triangles.length; t += 3)
    for (let c = 0; c < 3; c++)
      around[triangles[t + c]].push([triangles[t + ((c + 1) % 3)], triangles[t + ((c + 2) % 3)]]);
  const pairs = around.flat();
  let begin = 0;
  const ranges = around.map((own) => [begin, (begin += own.length)]);
  return {
    pairs: table(pairs.length, (i, data, at) => data.set(pairs[i], at)),
    ranges: table(count, (i, data, at) => data.set(ranges[i], at)),
  };
}

const FETCH = `
  precision highp float; precision highp int; precision highp sampler2D;
  uniform int width; uniform int count;
  out vec4 result;
  vec4 texel(sampler2D source, int i) { return texelFetch(source, ivec2(i % ${WIDTH}, i / ${WIDTH}), 0); }
  int self() { return int(gl_FragCoord.y) * width + int(gl_FragCoord.x); }`;

const POSITIONS = `${FETCH}
  uniform sampler2D rest; uniform sampler2D basis; uniform sampler2D q; uniform int k;
  void main() {
    int i = self();
    vec3 x = i < count ? texel(rest, i).xyz : vec3(0.0);
    if (i < count) for (int j = 0; j < k; j++) x += texel(basis, i * k + j).xyz * texel(q, j).x;
    result = vec4(x, 1.0);
  }`;

const NORMALS = `${FETCH}
  uniform sampler2D positions; uniform sampler2D pairs; uniform sampler2D ranges;
  vec3 at(float v) { int i = int(v + 0.5); return texelFetch(positions, ivec2(i % width, i / width), 0).xyz; }
  void main() {
    int i = self();
    vec3 normal = vec3(0.0);
    if (i < count) {
      vec3 x = at(float(i));
      vec2 range = texel(ranges, i).xy;
      for (int p = int(range.x); p < int(range.y); p++) {
        vec2 pair = texel(pairs, p).xy;
        normal += cross(at(pair.x) - x, at(pair.y) - x);
      }
    }
    result = vec4(normalize(normal + vec3(0.0, 0.0, 1e-30)), 1.0);
  }`;

const FULL_SCREEN = 'void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }';

/** Decodes into two textures that the vertex shader of the body reads: one pass for positions, one for normals. */
export class GpuDecoder {
  constructor(renderer, solid, space) {
    const count = solid.rest.length / 3;
    this.renderer = renderer;
    this.width = Math.ceil(Math.sqrt(count));
    const target = () =>
      new THREE.WebGLRenderTarget(this.width, Math.ceil(count / this.width), {
        type: THREE.FloatType,
        format: THREE.RGBAFormat,
        minFilter: THREE.NearestFilter,
        magFilter: THREE.NearestFilter,
        depthBuffer: false,
      });
    this.positions = target();
    this.normals = target();
    const { rest } = solid;
    const { basis, k } = space;
    this.q = table(k, () => {});
    const shared = { width: { value: this.width }, count: { value: count } };
    const { pairs, ranges } = fans(count, solid.triangles);
    this.passes = [
      [this.positions, POSITIONS, {
        rest: { value: table(count, (i, data, at) => data.set(rest.subarray(3 * i, 3 * i + 3), at)) },
        basis: {
          value: table(count * k, (n, data, at) => {
            const row = 3 * Math.floor(n / k) * k + (n % k);
            data[at] = basis[row];
            data[at + 1] = basis[row + k];
            data[at + 2] = basis[row + 2 * k];
          }),
        },
        q: { value: this.q },
        k: { value: k },
      }],
      [this.normals, NORMALS, {
        positions: { value: this.positions.texture },
        pairs: { value: pairs },
        ranges: { value: ranges },
      }],
    ].map(([into, fragmentShader, uniforms]) => ({
      into,
      material: new THREE.ShaderMaterial({
        vertexShader: FULL_SCREEN,
        fragmentShader,
        uniforms: { ...shared, ...uniforms },
        glslVersion: THREE.GLSL3,
        depthTest: false,
        depthWrite: false,
      }),
    }));
    this.screen = new THREE.Mesh(new THREE.PlaneGeometry(2, 2), this.passes[0].material);
    this.screen.frustumCulled = false;
    this.scene = new THREE.Scene().add(this.screen);
    this.camera = new THREE.Camera();
  }

  decode(q) {
    const { data } = this.q.image;
    for (let j = 0; j < q.length; j++) data[4 * j] = q[j];
    this.q.needsUpdate = true;
    for (const { into, material } of this.passes) {
      this.screen.material = material;
      this.renderer.setRenderTarget(into);
      this.renderer.render(this.scene, this.camera);
    }
    this.renderer.setRenderTarget(null);
  }

  /** The positions as the GPU has them, (3v); slow, for tests. */
  read(count) {
    const { width, height } = this.positions;
    const texels = new Float32Array(4 * width * height);
    this.renderer.readRenderTargetPixels(this.positions, 0, 0, width, height, texels);
    return Float32Array.from({ length: 3 * count }, (_, i) => texels[4 * Math.floor(i / 3) + (i % 3)]);
  }
}

/** Whether the renderer is a program on the CPU, where decoding in JavaScript is faster. */
export function isSoftware(renderer) {
  const gl = renderer.getContext();
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

/** Whether float textures can be drawn into. */
export function canDecode(renderer) {
  return renderer.getContext().getExtension('EXT_color_buffer_float') !== null;
}
