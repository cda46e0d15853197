// The hand: pointers that take hold of a body, pull, and let go or leave a grab behind.

import * as THREE from 'three';

const NEAR = 16; // pixels around a target that was left behind

/** The nearest hit of a ray on triangles: { distance, corners, share }, or null (Möller and Trumbore 1997). */
export function intersect(origin, direction, positions, triangles) {
  const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  const [p, t] = [new THREE.Vector3(), new THREE.Vector3()];
  let best = null;
  for (let i = 0; i < triangles.length; i += 3) {
    a.fromArray(positions, 3 * triangles[i]);
    b.fromArray(positions, 3 * triangles[i + 1]).sub(a);
    c.fromArray(positions, 3 * triangles[i + 2]).sub(a);
    p.crossVectors(direction, c);
    const determinant = b.dot(p);
    if (Math.abs(determinant) < 1e-20) continue;
    t.subVectors(origin, a);
    const u = t.dot(p) / determinant;
    if (u < 0 || u > 1) continue;
    t.cross(b);
    const v = direction.dot(t) / determinant;
    if (v < 0 || u + v > 1) continue;
    const distance = c.dot(t) / determinant;
    if (distance > 0 && (!best || distance < best.distance))
      best = { distance, corners: [triangles[i], triangles[i + 1], triangles[i + 2]], share: [1 - u - v, u, v] };
  }
  return best;
}

const blend = ({ corners, share }, positions) =>
  [0, 1, 2].map((axis) => corners.reduce((sum, corner, i) => sum + share[i] * positions[3 * corner + axis], 0));

export class Hand {
  /** stage: camera, canvas, controls, bodies, grabs; send: to the server; mode: "play" or "record". */
  constructor(stage, send, mode) {
    this.stage = stage;
    this.send = send;
    this.mode = mode;
    this.pulls = new Map();
    const { canvas } = stage;
    canvas.addEventListener('pointerdown', (event) => this.down(event), { capture: true });
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture'])
      canvas.addEventListener(end, (event) => this.up(event));
  }

  ray(event) {
    const { canvas, camera } = this.stage;
    const box = canvas.getBoundingClientRect();
    const pointer = new THREE.Vector2(
      (2 * (event.clientX - box.left)) / box.width - 1,
      1 - (2 * (event.clientY - box.top)) / box.height,
    );
    const caster = new THREE.Raycaster();
    caster.setFromCamera(pointer, camera);
    return caster.ray;
  }

  /** The grab left behind whose target is under the pointer, if there is one. */
  left(event) {
    const { canvas, camera, bodies, grabs } = this.stage;
    const box = canvas.getBoundingClientRect();
    for (const grab of grabs)
      for (const body of bodies) {
        const on = new THREE.Vector3(...grab.target).add(body.group.position);
        const { x, y } = on.clone().project(camera);
        const [dx, dy] = [((x + 1) / 2) * box.width + box.left - event.clientX, ((1 - y) / 2) * box.height + box.top - event.clientY];
        if (Math.hypot(dx, dy) < NEAR) return { id: grab.id, body, on };
      }
    return null;
  }

  hit(event) {
    const ray = this.ray(event);
    let best = null;
    for (const body of this.stage.bodies) {
      const origin = ray.origin.clone().sub(body.group.position);
      const found = intersect(origin, ray.direction, body.current(), body.solid.triangles);
      if (found && (!best || found.distance < best.distance)) best = { ...found, body };
    }
    return best && { ...best, on: ray.at(best.distance, new THREE.Vector3()) };
  }

  down(event) {
    if (event.button !== 0) return;
    const left = this.left(event);
    const hit = left ?? this.hit(event);
    if (!hit) return;
    event.stopImmediatePropagation();
    const { camera, canvas, controls } = this.stage;
    const facing = camera.getWorldDirection(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, hit.on);
    const id = left ? left.id : Math.floor(Math.random() * 2 ** 31);
    this.pulls.set(event.pointerId, { id, plane, body: hit.body, start: hit.on.clone(), moved: false, old: left !== null });
    canvas.setPointerCapture(event.pointerId);
    controls.enabled = false;
    if (left) return;
    const positions = this.mode === 'record' ? hit.body.current() : hit.body.solid.rest;
    const target = hit.on.clone().sub(hit.body.group.position).toArray();
    this.send('grab', { id, point: blend(hit, positions), target });
  }

  move(event) {
    const pull = this.pulls.get(event.pointerId);
    if (!pull) return;
    const on = this.ray(event).intersectPlane(pull.plane, new THREE.Vector3());
    if (!on) return;
    pull.moved ||= on.distanceTo(pull.start) > 0.005 * this.stage.diagonal;
    on.sub(pull.start).clampLength(0, 2 * this.stage.diagonal).add(pull.start);
    this.send('move', { id: pull.id, target: on.sub(pull.body.group.position).toArray() });
  }

  up(event) {
    const pull = this.pulls.get(event.pointerId);
    if (!pull) return;
    this.pulls.delete(event.pointerId);
    this.stage.controls.enabled = this.pulls.size === 0;
    const keep = this.mode === 'play' && (pull.old ? pull.moved : event.shiftKey);
    if (!keep) this.send('release', { id: pull.id });
  }
}
