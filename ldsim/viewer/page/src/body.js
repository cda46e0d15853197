// One solid in one space: its surface, its colours, its cubature points.

import * as THREE from 'three';
import { rows } from './creases.js';
import { GpuDecoder, decodeOnCpu, normalsOnCpu } from './decode.js';

export const SPACE_COLOURS = { latent: 0x2a9d8f, linear: 0xe0973a, full: 0x5b7fc7 };

const RAMP = `
  vec3 ramp(float t) {
    const vec3 c0 = vec3(0.06, 0.04, 0.20), c1 = vec3(0.29, 0.10, 0.45), c2 = vec3(0.72, 0.21, 0.36);
    const vec3 c3 = vec3(0.96, 0.50, 0.20), c4 = vec3(0.99, 0.93, 0.60);
    t = clamp(t, 0.0, 1.0) * 4.0;
    vec3 a = mix(c0, c1, clamp(t, 0.0, 1.0));
    a = mix(a, c2, clamp(t - 1.0, 0.0, 1.0));
    a = mix(a, c3, clamp(t - 2.0, 0.0, 1.0));
    return mix(a, c4, clamp(t - 3.0, 0.0, 1.0));
  }`;

/** The shader of a material reads positions and normals from the decoder's textures, and colours by the field. */
function patch(material, uniforms, decoder) {
  const fetch = (name) => `texelFetch(${name}, ivec2(gl_VertexID % ${decoder?.width}, gl_VertexID / ${decoder?.width}), 0).xyz`;
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    let vertex = shader.vertexShader;
    vertex = vertex.replace('#include <common>', `#include <common>
      uniform sampler2D decodedPositions; uniform sampler2D decodedNormals;
      uniform float shadeMode; uniform float shadeScale; uniform float shadeLevel;
      attribute vec3 rest; attribute float shade; attribute float pinned;
      varying float vShade; varying float vPinned;`);
    if (decoder) {
      vertex = vertex.replace('#include <beginnormal_vertex>', `vec3 objectNormal = ${fetch('decodedNormals')};`);
      vertex = vertex.replace('#include <begin_vertex>', `vec3 transformed = ${fetch('decodedPositions')};`);
    }
    vertex = vertex.replace('#include <project_vertex>', `#include <project_vertex>
      vShade = shadeMode > 2.5 ? shadeLevel : shadeMode > 1.5 ? shade : distance(transformed, rest) * shadeScale;
      vPinned = pinned;`);
    shader.vertexShader = vertex;
    shader.fragmentShader = shader.fragmentShader
      .replace('#include <common>', `#include <common>
        uniform float shadeMode; varying float vShade; varying float vPinned; ${RAMP}`)
      .replace('#include <color_fragment>', `#include <color_fragment>
        if (shadeMode > 0.5) diffuseColor.rgb = ramp(vShade);
        diffuseColor.rgb = mix(diffuseColor.rgb, vec3(0.13, 0.14, 0.16), 0.75 * smoothstep(0.6, 1.0, vPinned));`);
  };
  material.customProgramCacheKey = () => `ldsim ${decoder ? decoder.width : 'cpu'}`;
  return material;
}

export class Body {
  /** space: its block; gpu: whether to decode on the GPU; fine: whether the renderer can afford more than the least. */
  constructor(renderer, solid, space, gpu, fine) {
    this.fine = fine;
    this.solid = solid;
    this.space = space.k ? { ...space, basis: rows(space.basis, 3 * space.k, solid.source) } : space;
    this.count = solid.rest.length / 3;
    this.positions = solid.rest.slice();
    this.normals = new Float32Array(this.positions.length);
    this.q = new Float32Array(space.k || 3 * solid.own);
    this.decoder = gpu && space.k ? new GpuDecoder(renderer, solid, this.space) : null;
    this.fresh = false;
    this.group = new THREE.Group();
    this.group.add(this.makeSurface());
    this.group.add(this.makePoints());
    this.show(this.q);
  }

  makeSurface() {
    const { solid } = this;
    const geometry = new THREE.BufferGeometry();
    const attribute = (name, data, size) => geometry.setAttribute(name, new THREE.BufferAttribute(data, size));
    this.position = attribute('position', this.positions, 3).getAttribute('position');
    attribute('normal', this.normals, 3);
    attribute('rest', solid.rest, 3);
    attribute('pinned', Float32Array.from(solid.pinned), 1);
    this.shade = new THREE.BufferAttribute(new Float32Array(this.count), 1);
    geometry.setAttribute('shade', this.shade);
    geometry.setIndex(new THREE.BufferAttribute(solid.triangles, 1));
    this.uniforms = {
      decodedPositions: { value: this.decoder?.positions.texture ?? null },
      decodedNormals: { value: this.decoder?.normals.texture ?? null },
      shadeMode: { value: 0 },
      shadeLevel: { value: 0 },
      shadeScale: { value: 4 / solid.diagonal },
    };
    const own = { color: SPACE_COLOURS[this.space.space], roughness: 0.5, side: THREE.DoubleSide };
    this.material = patch(
      this.fine
        ? new THREE.MeshPhysicalMaterial({ ...own, clearcoat: 0.35, clearcoatRoughness: 0.45 })
        : new THREE.MeshLambertMaterial({ color: own.color, side: own.side }),
      this.uniforms,
      this.decoder,
    );
    this.surface = new THREE.Mesh(geometry, this.material);
    this.surface.customDepthMaterial = patch(new THREE.MeshDepthMaterial({ depthPacking: THREE.RGBADepthPacking }), this.uniforms, this.decoder);
    this.surface.castShadow = this.surface.receiveShadow = true;
    this.surface.frustumCulled = false;
    return this.surface;
  }

  makePoints() {
    const count = this.space.k ? this.space.point_rest.length / 3 : 0;
    const size = 0.011 * this.solid.diagonal;
    this.points = new THREE.InstancedMesh(
      new THREE.SphereGeometry(size, 12, 8),
      new THREE.MeshStandardMaterial({ color: 0xff5a5f, roughness: 0.4, emissive: 0x661f22 }),
      count,
    );
    this.pointPositions = new Float32Array(3 * count);
    this.points.visible = false;
    this.points.frustumCulled = false;
    return this.points;
  }

  /** The shape of coordinates q, or of displacements where the space is full. */
  show(q) {
    this.q = q.slice();
    this.fresh = false;
    if (this.decoder) this.decoder.decode(q);
    else {
      this.current();
      normalsOnCpu(this.positions, this.solid.triangles, this.normals);
      this.position.needsUpdate = true;
      this.surface.geometry.getAttribute('normal').needsUpdate = true;
    }
    if (this.points.visible) this.showPoints();
  }

  /** Positions of the surface now, (3v), in the frame of the solid. */
  current() {
    if (this.fresh) return this.positions;
    const { rest, source } = this.solid;
    if (this.space.k) decodeOnCpu(rest, this.space.basis, this.space.k, this.q, this.positions);
    else for (let i = 0; i < rest.length; i++) this.positions[i] = rest[i] + this.q[3 * source[Math.floor(i / 3)] + (i % 3)];
    this.fresh = true;
    return this.positions;
  }

  showPoints() {
    const { point_rest, point_basis, k } = this.space;
    decodeOnCpu(point_rest, point_basis, k, this.q, this.pointPositions);
    const matrix = new THREE.Matrix4();
    for (let i = 0; i < this.points.count; i++)
      this.points.setMatrixAt(i, matrix.makeTranslation(...this.pointPositions.subarray(3 * i, 3 * i + 3)));
    this.points.instanceMatrix.needsUpdate = true;
  }

  setPoints(visible) {
    this.points.visible = visible && this.points.count > 0;
    this.material.transparent = this.points.visible;
    this.material.opacity = this.points.visible ? 0.38 : 1;
    this.material.depthWrite = !this.points.visible;
    this.material.needsUpdate = true;
    if (this.points.visible) this.showPoints();
  }

  /** mode: 0 the space's own colour, 1 displacement, 2 what the server sends, 3 one colour for the distrust. */
  setMode(mode) {
    this.uniforms.shadeMode.value = mode;
  }

  /** Distrust from 0 to 2, where 1 is where to warn; the space's own colour where it is not known. */
  setDistrust(value) {
    this.uniforms.shadeMode.value = Number.isFinite(value) ? 3 : 0;
    this.uniforms.shadeLevel.value = Math.min(value, 2) / 2;
  }

  setShade(values) {
    this.solid.source.forEach((vertex, i) => (this.shade.array[i] = values[vertex] / 255));
    this.shade.needsUpdate = true;
  }

  dispose() {
    this.surface.geometry.dispose();
    this.material.dispose();
  }
}
