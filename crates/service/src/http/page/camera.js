// The camera: vectors, and what drags, wheels, fingers and keys do to it. The habits are three.js's OrbitControls'.

const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const scale = (a, s) => a.map((x) => x * s);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const unit = (a) => scale(a, 1 / (length(a) || 1));

/** `v` turned around the unit axis by an angle in radians (Rodrigues). */
function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
}

export class Camera {
  constructor(pose, least, greatest) {
    this.home = structuredClone(pose);
    this.bounds = { least, greatest };
    Object.assign(this, structuredClone(pose));
  }

  get pose() {
    const { eye, target, up, fov, lens } = this;
    return { eye, target, up, fov, lens };
  }

  get distance() {
    return length(sub(this.eye, this.target));
  }

  /** Right, up and forward as unit vectors. */
  axes() {
    const forward = unit(sub(this.target, this.eye));
    const right = unit(cross(forward, this.up));
    return { forward, right, above: cross(right, forward) };
  }

  /** Turns around the target: angles in radians. */
  orbit(sideways, upwards) {
    const up = unit(this.up);
    let arm = turned(sub(this.eye, this.target), up, -sideways);
    const polar = Math.acos(Math.min(1, Math.max(-1, dot(unit(arm), up))));
    // Never over the pole, where the picture would turn upside down.
    const change = Math.min(Math.PI - 0.02, Math.max(0.02, polar - upwards)) - polar;
    arm = turned(arm, unit(cross(up, arm)), change);
    this.eye = add(this.target, arm);
  }

  /** Moves eye and target to the right and up, by shares of the picture's height at the target. */
  pan(right, upwards) {
    const height = 2 * this.distance * Math.tan(((this.fov ?? 40) * Math.PI) / 360);
    const axes = this.axes();
    const by = add(scale(axes.right, right * height), scale(axes.above, upwards * height));
    this.eye = add(this.eye, by);
    this.target = add(this.target, by);
  }

  /** Multiplies the distance to the target. */
  dolly(factor) {
    this.eye = add(this.target, scale(sub(this.eye, this.target), factor));
  }

  /** Walks forward, to the right and up, by shares of the size of the scene. */
  walk(forward, right, upwards) {
    const axes = this.axes();
    const size = length(sub(this.bounds.greatest, this.bounds.least)) || 1;
    const ahead = add(scale(axes.forward, forward), scale(axes.right, right));
    const by = scale(add(ahead, scale(unit(this.up), upwards)), size);
    this.eye = add(this.eye, by);
    this.target = add(this.target, by);
  }

  /** Looks at a point: the new pivot. An open aperture is focused on the plane at this depth. */
  focus(point, depth) {
    this.target = point;
    if (this.lens) this.lens = { ...this.lens, focus_distance: depth };
  }

  /** Opens the aperture to a radius; 0 closes it. */
  open(radius) {
    const focus_distance = this.lens?.focus_distance ?? this.distance;
    this.lens = radius > 0 ? { radius, focus_distance } : null;
  }

  /** All of the scene, from where the camera looks now. */
  frameAll() {
    const { least, greatest } = this.bounds;
    const middle = scale(add(least, greatest), 0.5);
    const radius = length(sub(greatest, least)) / 2 || 1;
    const { forward } = this.axes();
    const distance = radius / Math.sin(((this.fov ?? 40) * Math.PI) / 360);
    this.target = middle;
    this.eye = sub(middle, scale(forward, distance));
  }

  reset() {
    Object.assign(this, structuredClone(this.home));
  }

  /** The camera as flags of `raystream render`. */
  flags() {
    const numbers = (v) => v.map((x) => Number(x.toPrecision(6))).join(",");
    const { eye, target, up, fov, lens } = this;
    let flags = `--eye ${numbers(eye)} --target ${numbers(target)} --up ${numbers(up)}`;
    if (fov !== null) flags += ` --fov ${Number(fov.toPrecision(6))}`;
    if (!lens) return flags;
    const [radius, distance] = [lens.radius, lens.focus_distance].map((x) => numbers([x]));
    return `${flags} --aperture-radius ${radius} --focus-distance ${distance}`;
  }
}

/** Steers a camera by a canvas's events. `moved` is called after each change, `clicked` and `focused` with a place,
 * `toggled` by the space bar. */
export class Controls {
  constructor(canvas, { camera, moved, clicked, focused, hovered, toggled }) {
    Object.assign(this, { canvas, camera, moved, clicked, focused, hovered, toggled });
    this.pointers = new Map();
    this.keys = new Set();
    this.travelled = 0;
    const on = (name, handler, options) => canvas.addEventListener(name, handler.bind(this), options);
    on("pointerdown", this.down);
    on("pointermove", this.move);
    on("pointerup", this.up);
    on("pointercancel", this.up);
    on("dblclick", (event) => this.focused(this.place(event)));
    on("contextmenu", (event) => event.preventDefault());
    on("wheel", this.wheel, { passive: false });
    on("keydown", this.key);
    on("keyup", (event) => this.keys.delete(event.key.toLowerCase()));
    on("blur", () => this.keys.clear());
  }

  /** The place of an event, 0 to 1 to the right and down. */
  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, button: event.button });
    if (this.pointers.size === 1) this.travelled = 0;
  }

  move(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      if (event.pointerType === "mouse") this.hovered(this.place(event));
      return;
    }
    const camera = this.camera();
    if (!camera) return;
    const height = this.canvas.clientHeight || 1;
    const [dx, dy] = [(event.clientX - last.x) / height, (event.clientY - last.y) / height];
    this.travelled += Math.abs(event.clientX - last.x) + Math.abs(event.clientY - last.y);
    if (this.pointers.size === 2) {
      const spread = () => {
        const [a, b] = [...this.pointers.values()];
        return Math.hypot(a.x - b.x, a.y - b.y) || 1;
      };
      const before = spread();
      Object.assign(last, { x: event.clientX, y: event.clientY });
      camera.dolly(before / spread());
      camera.pan(-dx / 2, dy / 2);
    } else if (last.button === 2 || event.ctrlKey || event.metaKey || event.shiftKey) {
      camera.pan(-dx, dy);
    } else if (last.button === 1) {
      camera.dolly(Math.exp(2 * dy));
    } else {
      camera.orbit(2 * Math.PI * dx, 2 * Math.PI * dy);
    }
    Object.assign(last, { x: event.clientX, y: event.clientY });
    this.moved();
  }

  up(event) {
    const had = this.pointers.delete(event.pointerId);
    if (had && event.type === "pointerup" && event.button === 0 && this.travelled < 4) this.clicked(this.place(event));
  }

  wheel(event) {
    event.preventDefault();
    // Lines and pages count as pixels do.
    const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
    this.camera()?.dolly(Math.exp(Math.max(-1, Math.min(1, pixels * 0.0015))));
    this.moved();
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const camera = this.camera();
    const key = event.key.toLowerCase();
    if (!camera) return;
    if (key === " ") {
      event.preventDefault();
      return this.toggled();
    }
    if (key === "f") camera.frameAll();
    else if (key === "r") camera.reset();
    else if (key === "arrowleft") camera.pan(-0.04, 0);
    else if (key === "arrowright") camera.pan(0.04, 0);
    else if (key === "arrowup") camera.pan(0, 0.04);
    else if (key === "arrowdown") camera.pan(0, -0.04);
    else if ("wasdqe".includes(key)) return this.startWalk(key, event);
    else return;
    event.preventDefault();
    this.moved();
  }

  /** Walks as long as keys are down. */
  startWalk(key, event) {
    event.preventDefault();
    const walks = this.keys.size > 0;
    this.keys.add(key);
    if (walks) return;
    let last = performance.now() - 16;
    const step = (now) => {
      if (this.keys.size === 0) return;
      // A quarter of the scene's size a second.
      const by = Math.max(0, Math.min(0.1, (now - last) / 1000)) * 0.25;
      last = now;
      const along = (plus, minus) => (this.keys.has(plus) ? by : 0) - (this.keys.has(minus) ? by : 0);
      this.camera()?.walk(along("w", "s"), along("d", "a"), along("e", "q"));
      this.moved();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}
