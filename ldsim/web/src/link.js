// The link to the server: blocks by HTTP, frames and messages by a socket that comes back when it is lost.

import { fetchBlock } from "./arrays.js";

const RETRY = 1000;

const SPACE = "Uint32 count,Float32 milliseconds,Float32 iterations,Float32 evaluations,Uint32 outcome,Uint32 troubled,Float32 novelty,Float32 distance,Float32 error";

/** The frame in a binary message, as `frame_bytes` in Python writes it. */
function readFrame(buffer) {
  const view = new DataView(buffer), spaces = [], grabs = [];
  const [spaceCount, grabCount, flags] = [1, 2, 3].map((i) => view.getUint8(i));
  let at = 24;
  for (let i = 0; i < spaceCount; i++) {
    const fields = SPACE.split(",").map((field) => field.split(" "));
    const space = Object.fromEntries(fields.map(([type, name], n) => [name, view[`get${type}`](at + 4 * n, true)]));
    spaces.push({ ...space, q: new Float32Array(buffer, at + 36, space.count) });
    at += 36 + 4 * space.count;
  }
  for (let i = 0; i < grabCount; i++) {
    const values = new Float32Array(buffer, at + 4, 3 + 3 * spaceCount);
    grabs.push({ id: view.getUint32(at, true), target: values.slice(0, 3), centroids: values.slice(3) });
    at += 4 + values.byteLength;
  }
  const [number, seconds] = [view.getUint32(4, true), view.getFloat32(8, true)];
  return { number, seconds, paused: (flags & 1) > 0, bytes: buffer.byteLength, spaces, grabs };
}

function readColours(buffer) {
  const view = new DataView(buffer);
  return { space: view.getUint8(1), high: view.getFloat32(8, true), values: new Uint8Array(buffer, 12) };
}

export class Link {
  lost = false;
  solid = () => fetchBlock("solid");
  space = (name) => fetchBlock(`space/${name}`);

  /** handlers: frame, colours, status, notice, lost, found. */
  connect(handlers) {
    this.handlers = handlers;
    const url = new URL("socket", location.href);
    url.protocol = "ws:";
    this.socket = new WebSocket(url);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      if (this.lost) this.handlers.found();
      this.lost = false;
    };
    this.socket.onmessage = ({ data }) => this.receive(data);
    this.socket.onclose = () => {
      if (!this.lost) this.handlers.lost();
      this.lost = true;
      setTimeout(() => this.connect(handlers), RETRY);
    };
  }

  receive(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      this.handlers[message.kind](message);
    } else if (new Uint8Array(data, 0, 1)[0] === 1) this.handlers.frame(readFrame(data));
    else this.handlers.colours(readColours(data));
  }

  send(kind, values = {}) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ kind, ...values }));
  }
}
