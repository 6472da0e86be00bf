// The WebSocket of a live view: frames in, requests out, and a new connection when one ends.

const HEADER_BYTES = 32;
/** The code of a connection that is closed because there is nothing to show: the same again would be refused again. */
const REFUSED = 4001;
const RETRY_MS = [250, 500, 1000, 2000];

/** A frame's header and payload; null if it is none. */
export function parseFrame(buffer) {
  if (buffer.byteLength < HEADER_BYTES) return null;
  const view = new DataView(buffer);
  if (view.getUint32(0) !== 0x52534631) return null; // "RSF1"
  const flags = view.getUint8(5);
  return {
    kind: { 1: "jpeg", 5: "png", 6: "exr" }[view.getUint8(4)],
    moving: (flags & 1) !== 0,
    last: (flags & 2) !== 0,
    generation: view.getUint32(8, true),
    sequence: view.getUint32(12, true),
    width: view.getUint16(20, true),
    height: view.getUint16(22, true),
    spp: view.getUint32(24, true),
    time: view.getUint32(28, true),
    bytes: new Uint8Array(buffer, HEADER_BYTES),
  };
}

/** Whether a frame is newer than the one that is shown. Generations and numbers never fall. */
export function isNewer(frame, shown) {
  return frame.generation >= shown.generation && frame.sequence > shown.sequence;
}

export class Connection {
  /**
   * `on.open()` is called for each new connection, `on.reply(message)`, `on.frame(frame, bitmap)` for each frame that
   * is to be shown, `on.file(frame)`, and `on.state("open" | "retry" | "refused" | "closed")`.
   */
  constructor(url, on) {
    Object.assign(this, { url, on, generation: 0, attempts: 0, isOver: false });
    this.shown = { generation: 0, sequence: 0 };
    this.newest = null;
    this.isDrawing = false;
    this.connect();
  }

  connect() {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.attempts = 0;
      // Frames are numbered anew.
      this.shown = { generation: this.shown.generation, sequence: 0 };
      this.newest = null;
      this.on.state("open");
    };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") return this.on.reply(JSON.parse(data));
      this.take(data, socket);
    };
    socket.onclose = ({ code }) => {
      if (this.isOver) return;
      if (code === REFUSED) {
        this.isOver = true;
        return this.on.state("refused");
      }
      this.on.state("retry");
      const wait = RETRY_MS[Math.min(this.attempts++, RETRY_MS.length - 1)];
      setTimeout(() => this.isOver || this.connect(), wait);
    };
  }

  close() {
    this.isOver = true;
    this.socket.close();
    this.on.state("closed");
  }

  /** Sends a request. Without a connection it is left out: what is wanted is sent when there is one. */
  send(request) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }

  /** Sends a request that changes the picture. */
  change(request) {
    this.send({ ...request, generation: ++this.generation });
    window.raystream.asked = this.generation;
  }

  take(data, socket) {
    const frame = parseFrame(data);
    if (!frame) return;
    if (frame.kind !== "jpeg") return this.on.file(frame);
    // Only the newest is drawn; a frame that is not drawn is a credit all the same.
    if (this.newest) this.acknowledge(this.newest, socket);
    this.newest = null;
    if (!isNewer(frame, this.shown)) return this.acknowledge(frame, socket);
    this.newest = frame;
    this.draw(socket);
  }

  acknowledge({ sequence }, socket) {
    if (socket === this.socket) this.send({ type: "ack", sequence });
  }

  /** Decodes and shows one frame after the other. */
  async draw(socket) {
    if (this.isDrawing) return;
    this.isDrawing = true;
    while (this.newest) {
      const frame = this.newest;
      this.newest = null;
      try {
        const bitmap = await createImageBitmap(new Blob([frame.bytes], { type: "image/jpeg" }));
        if (isNewer(frame, this.shown) && socket === this.socket) {
          this.shown = frame;
          this.on.frame(frame, bitmap);
        }
        bitmap.close();
      } catch (error) {
        console.warn("a frame could not be decoded", error);
      }
      this.acknowledge(frame, socket);
    }
    this.isDrawing = false;
  }
}
