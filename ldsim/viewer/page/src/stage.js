// The stage: renderer, camera, lights, ground, the bodies on it and the grabs that pull on them.

import * as THREE from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { RoomEnvironment } from 'three/addons/environments/RoomEnvironment.js';
import { Body } from './body.js';
import { canDecode, isSoftware } from './decode.js';

// The backdrop is the page's own; the floor adds a shadow and a grid to it.
const THEMES = {
  dark: { shadow: 0.55, grid: 0x5b6878, light: 0.6 },
  light: { shadow: 0.2, grid: 0x9aa6b5, light: 0.9 },
};
// The controls cover the right of a wide window, so the picture moves to the left by half of them.
const [WIDE, COVERED] = [900, 300];
const AXES = [new THREE.Vector3(1, 0, 0), new THREE.Vector3(0, 1, 0), new THREE.Vector3(0, 0, 1)];

export class Stage {
  constructor(canvas, solid, { decode, quality }) {
    this.canvas = canvas;
    this.solid = solid;
    this.bodies = [];
    this.grabs = [];
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.software = isSoftware(this.renderer);
    this.fine = quality === 'fine' || (quality !== 'plain' && !this.software);
    this.gpu = decode === 'gpu' || (decode !== 'cpu' && !this.software && canDecode(this.renderer));
    this.renderer.setPixelRatio(this.fine ? Math.min(devicePixelRatio, 2) : 1);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.renderer.toneMapping = THREE.NeutralToneMapping;
    this.scene = new THREE.Scene();
    this.measure();
    this.light();
    this.camera = new THREE.PerspectiveCamera(35, 1, this.diagonal / 100, this.diagonal * 60);
    this.camera.up.copy(this.up);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.makeGrabs();
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  /** Box, diagonal and the upward axis, which is against gravity. */
  measure() {
    this.box = new THREE.Box3().setFromArray(this.solid.rest);
    this.diagonal = this.box.getSize(new THREE.Vector3()).length();
    this.solid.diagonal = this.diagonal;
    const gravity = this.solid.gravity.map(Math.abs);
    const axis = Math.max(...gravity) > 0 ? gravity.indexOf(Math.max(...gravity)) : 1;
    this.up = AXES[axis].clone().multiplyScalar(this.solid.gravity[axis] > 0 ? -1 : 1);
    const others = AXES.filter((_, i) => i !== axis);
    const size = this.box.getSize(new THREE.Vector3());
    others.sort((a, b) => size.dot(b) - size.dot(a));
    [this.right, this.toward] = others;
    if (this.right.clone().cross(this.up).dot(this.toward) < 0) this.toward = this.toward.clone().negate();
    this.aside = Math.max(size.dot(this.right) * 1.35, 0.55 * this.diagonal);
  }

  light() {
    const { scene, up, right, toward, diagonal } = this;
    const centre = this.box.getCenter(new THREE.Vector3());
    if (this.fine) scene.environment = new THREE.PMREMGenerator(this.renderer).fromScene(new RoomEnvironment(), 0.04).texture;
    else {
      this.hemisphere = new THREE.HemisphereLight(0xe6eeff, 0x4a4640, 1);
      this.hemisphere.position.copy(up);
      scene.add(this.hemisphere);
    }
    this.key = new THREE.DirectionalLight(0xfff3e4, this.fine ? 1.9 : 2.2);
    this.key.position.copy(centre).addScaledVector(up, 1.9 * diagonal).addScaledVector(right, -1.0 * diagonal).addScaledVector(toward, 2.1 * diagonal);
    this.key.target.position.copy(centre);
    this.key.castShadow = true;
    this.key.shadow.mapSize.setScalar(this.fine ? 2048 : 512);
    this.key.shadow.radius = 5;
    this.key.shadow.normalBias = 0.014 * diagonal;
    const rim = new THREE.DirectionalLight(0xb9d4ff, 0.9);
    rim.position.copy(centre).addScaledVector(up, 0.6 * diagonal).addScaledVector(right, diagonal).addScaledVector(toward, -1.5 * diagonal);
    rim.target.position.copy(centre);
    scene.add(this.key, this.key.target, rim, rim.target);
    this.floor = this.makeFloor(centre);
    scene.add(this.floor);
  }

  /** A disc that shows nothing but the shadow on it and a grid that fades. */
  makeFloor(centre) {
    const cell = 10 ** Math.floor(Math.log10(this.diagonal / 3));
    const material = new THREE.ShadowMaterial({ transparent: true });
    this.grid = { value: new THREE.Color() };
    material.onBeforeCompile = (shader) => {
      shader.uniforms.grid = this.grid;
      shader.vertexShader = shader.vertexShader
        .replace('#include <common>', '#include <common>\nvarying vec2 vFloor;')
        .replace('#include <begin_vertex>', '#include <begin_vertex>\nvFloor = position.xy;');
      shader.fragmentShader = shader.fragmentShader
        .replace('#include <common>', '#include <common>\nvarying vec2 vFloor; uniform vec3 grid;')
        .replace('#include <tonemapping_fragment>', `
          vec2 cells = vFloor / ${cell.toExponential()};
          vec2 line = abs(fract(cells - 0.5) - 0.5) / fwidth(cells);
          float ink = 0.45 * (1.0 - min(min(line.x, line.y), 1.0)) * exp(-pow(length(vFloor) / ${this.diagonal.toFixed(6)}, 2.0));
          gl_FragColor = mix(gl_FragColor, vec4(grid, 1.0), ink);
          #include <tonemapping_fragment>`);
    };
    const floor = new THREE.Mesh(new THREE.CircleGeometry(5 * this.diagonal, 64), material);
    floor.receiveShadow = true;
    floor.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), this.up);
    const low = Math.min(this.up.dot(this.box.min), this.up.dot(this.box.max));
    const drop = this.pinsBelow(low) ? 0.002 : 0.45;
    floor.position.copy(centre).addScaledVector(this.up, low - this.up.dot(centre) - drop * this.diagonal);
    return floor;
  }

  /** Whether the solid stands on its pins, so that the floor may touch it. */
  pinsBelow(low) {
    const { rest, pinned } = this.solid;
    const x = new THREE.Vector3();
    let [sum, count] = [0, 0];
    for (let i = 0; i < pinned.length; i++)
      if (pinned[i]) {
        sum += this.up.dot(x.fromArray(rest, 3 * i)) - low;
        count += 1;
      }
    return count > 0 && sum / count < 0.1 * this.diagonal;
  }

  setTheme(name) {
    const theme = THEMES[name];
    this.floor.material.opacity = theme.shadow;
    this.grid.value.set(theme.grid);
    this.scene.environmentIntensity = 0.45 * theme.light;
    if (this.hemisphere) this.hemisphere.intensity = 2 * theme.light;
    document.documentElement.dataset.theme = name;
  }

  /** The spaces of these blocks, side by side. */
  setSpaces(spaces) {
    for (const body of this.bodies) {
      this.scene.remove(body.group);
      body.dispose();
    }
    this.bodies = spaces.map((space, i) => {
      const body = new Body(this.renderer, this.solid, space, this.gpu, this.fine);
      body.group.position.copy(this.right).multiplyScalar((i - (spaces.length - 1) / 2) * this.aside);
      this.scene.add(body.group);
      return body;
    });
    const reach = (0.75 + 0.5 * (spaces.length - 1)) * Math.max(this.aside, this.diagonal);
    Object.assign(this.key.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.2 * this.diagonal, far: 6 * this.diagonal });
    this.key.shadow.camera.updateProjectionMatrix();
    this.look();
  }

  /** All bodies in view, a little from above and the side. */
  look() {
    const centre = this.box.getCenter(new THREE.Vector3());
    const span = this.diagonal * 1.02 + Math.max(this.bodies.length - 1, 0) * this.aside;
    const { clientWidth: width } = this.canvas;
    const free = width > WIDE ? (width - COVERED) / width : 1;
    const fit = Math.max(span / (this.camera.aspect * free), this.diagonal) / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
    this.camera.position.copy(centre).addScaledVector(this.toward, 1.05 * fit + 0.2 * this.diagonal)
      .addScaledVector(this.up, 0.32 * fit).addScaledVector(this.right, 0.28 * fit);
    this.controls.target.copy(centre);
    this.controls.update();
  }

  makeGrabs() {
    const material = new THREE.MeshStandardMaterial({ color: 0xffd166, emissive: 0x7a5a10, roughness: 0.35 });
    const ball = (size) => new THREE.SphereGeometry(size * this.diagonal, 20, 14);
    this.grabMeshes = Array.from({ length: 8 * 3 }, () => {
      const group = new THREE.Group();
      const target = new THREE.Mesh(ball(0.017), material);
      const end = new THREE.Mesh(ball(0.01), material);
      const rod = new THREE.Mesh(new THREE.CylinderGeometry(0.0035 * this.diagonal, 0.0035 * this.diagonal, 1, 10), material);
      group.add(target, end, rod);
      group.visible = false;
      this.scene.add(group);
      return { group, target, end, rod };
    });
  }

  setGrabs(grabs) {
    this.grabs = grabs;
    const [from, to, y] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3(0, 1, 0)];
    this.grabMeshes.forEach((mesh, n) => {
      const [grab, i] = [grabs[Math.floor(n / 3)], n % 3];
      mesh.group.visible = Boolean(grab && i < this.bodies.length);
      if (!mesh.group.visible) return;
      to.fromArray(grab.target);
      from.fromArray(grab.centroids, 3 * i);
      mesh.group.position.copy(this.bodies[i].group.position);
      mesh.target.position.copy(to);
      mesh.end.position.copy(from);
      mesh.rod.position.addVectors(from, to).multiplyScalar(0.5);
      mesh.rod.scale.y = Math.max(from.distanceTo(to), 1e-9);
      mesh.rod.quaternion.setFromUnitVectors(y, to.clone().sub(from).normalize());
    });
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    const aside = clientWidth > WIDE ? COVERED / 2 : 0;
    this.camera.setViewOffset(clientWidth, clientHeight, aside, 0, clientWidth, clientHeight);
    this.camera.updateProjectionMatrix();
    this.look();
  }

  draw() {
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }

  /** Where a point of a body is in the window, pixels; for tests and labels. */
  toScreen(point, body) {
    const { x, y } = new THREE.Vector3(...point).add(body.group.position).project(this.camera);
    const box = this.canvas.getBoundingClientRect();
    return [box.left + ((x + 1) / 2) * box.width, box.top + ((1 - y) / 2) * box.height];
  }
}
