// The link to the server: blocks by HTTP, frames and messages by a socket that comes back when it is lost.

import { fetchBlock } from "./arrays.js";

const RETRY = 1000;

/** The frame in a binary message. */
function readFrame(buffer) {
  const view = new DataView(buffer);
  const [spaceCount, grabCount, flags] = [view.getUint8(1), view.getUint8(2), view.getUint8(3)];
  const frame = {
    number: view.getUint32(4, true),
    seconds: view.getFloat32(8, true),
    paused: (flags & 1) > 0,
    recording: (flags & 2) > 0,
    replaying: (flags & 4) > 0,
    bytes: buffer.byteLength,
    spaces: [],
    grabs: [],
  };
  let at = 24;
  for (let i = 0; i < spaceCount; i++) {
    const count = view.getUint32(at, true);
    frame.spaces.push({
      milliseconds: view.getFloat32(at + 4, true),
      iterations: view.getFloat32(at + 8, true),
      evaluations: view.getFloat32(at + 12, true),
      outcome: view.getUint32(at + 16, true),
      troubled: view.getUint32(at + 20, true),
      novelty: view.getFloat32(at + 24, true),
      q: new Float32Array(buffer, at + 28, count),
    });
    at += 28 + 4 * count;
  }
  for (let i = 0; i < grabCount; i++) {
    const id = view.getUint32(at, true);
    const values = new Float32Array(buffer, at + 4, 3 + 3 * spaceCount);
    frame.grabs.push({ id, target: values.slice(0, 3), centroids: values.slice(3) });
    at += 4 + values.byteLength;
  }
  return frame;
}

function readColours(buffer) {
  const view = new DataView(buffer);
  return {
    space: view.getUint8(1),
    low: view.getFloat32(4, true),
    high: view.getFloat32(8, true),
    values: new Uint8Array(buffer, 12),
  };
}

export class Link {
  solid() {
    return fetchBlock("solid");
  }

  space(name) {
    return fetchBlock(`space/${name}`);
  }

  /** handlers: frame, colours, status, notice, lost, found. */
  connect(handlers) {
    this.handlers = handlers;
    this.lost = false;
    this.open();
  }

  open() {
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
      setTimeout(() => this.open(), RETRY);
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
