// The live view: connects the page's controls to a connection.

import { Camera, Controls } from "./camera.js";
import { Connection } from "./connection.js";
import { Player } from "./player.js";
import { ListPlot, TimelinePlot } from "./plots.js";

const SIZES = ["1280x720", "960x540", "640x360", "1920x1080", "720x720", "540x960"];
const EXAMPLE = `fn pattern(at: Point) -> Finish {
    var finish = matte(at);
    let stripe = step(0.5, fract(at.position.y * 8.0));
    finish.colour = mix(vec3f(0.05), vec3f(0.8, 0.3, 0.1), stripe);
    return finish;
}
`;

const $ = (id) => document.getElementById(id);
const brief = new Intl.NumberFormat("en", { notation: "compact", maximumSignificantDigits: 3 });
const number = (x) => (x === null || x === undefined ? "–" : Number(x.toPrecision(4)).toString());

/** Linear light 0..1 to a byte of sRGB, and back. */
const toSrgb = (x) => Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
const fromSrgb = (byte) => {
  const x = byte / 255;
  return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
};
const toHex = (colour) => `#${colour.map((x) => toSrgb(Math.min(1, x)).toString(16).padStart(2, "0")).join("")}`;
const fromHex = (hex) => [1, 3, 5].map((at) => fromSrgb(parseInt(hex.slice(at, at + 2), 16)));

export class Live {
  /** `refused(reason)` is called once if the service shows nothing at this address. */
  constructor(url, refused) {
    this.refused = refused;
    this.canvas = $("picture");
    this.context = this.canvas.getContext("2d");
    this.lists = new ListPlot($("lists"));
    this.timeline = new TimelinePlot($("timeline"));
    this.camera = null;
    this.selected = null;
    /** What the client has changed, to be told again after a new connection. */
    this.wanted = { edits: new Map(), shaders: new Map(), size: null, layer: null, scheduling: null, quality: null };
    this.picks = new Map();
    this.nextPick = 1;
    this.isSent = false;
    // What the view before was told.
    this.notice(null);
    window.raystream = { gen: 0, asked: 0, spp: 0, frames: 0 };
    this.player = new Player((request) => this.connection.change(request));
    this.connection = new Connection(url, {
      state: (state) => this.tellState(state),
      reply: (reply) => this.take(reply),
      frame: (frame, bitmap) => this.show(frame, bitmap),
      file: (file) => this.save(file),
    });
    this.controls = new Controls(this.canvas, {
      camera: () => this.camera,
      moved: () => this.moved(),
      clicked: (place) => this.pick(place, (hit) => this.select(hit)),
      focused: (place) => this.pick(place, (hit) => this.focus(hit)),
      hovered: (place) => this.hover(place),
      toggled: () => this.player.toggle(),
    });
    this.bind();
  }

  close() {
    this.notice(null);
    this.player.offer({ animations: [], readsTime: false });
    this.connection.close();
  }

  tellState(state) {
    const told = { open: "connected", retry: "reconnecting …", refused: "nothing to show", closed: "offline" }[state];
    $("connection").dataset.state = state;
    $("connection").textContent = told;
    if (state === "refused") {
      // What is refused stays refused, so the reason stays, too.
      clearTimeout(this.noticeTimer);
      this.refused($("notice").textContent);
    }
  }

  notice(text) {
    $("notice").textContent = text ?? "";
    $("notice").hidden = !text;
    clearTimeout(this.noticeTimer);
    if (text) this.noticeTimer = setTimeout(() => ($("notice").hidden = true), 9000);
  }

  take(reply) {
    const { type, ...content } = reply;
    if (type === "hello") this.hello(content);
    else if (type === "statistics") this.statistics(content);
    else if (type === "timeline") this.takeTimeline(content);
    else if (type === "picked") this.picked(content);
    else if (type === "shader") this.shaderAnswer(content);
    else if (type === "spec") this.saveSpec(content);
    else if (type === "refused") this.notice(content.reason);
  }

  hello(hello) {
    $("scene-name").textContent = `${hello.scene} · ${hello.triangles.toLocaleString("en")} triangles`;
    const fill = (id, names, first) => {
      const chosen = $(id).value;
      const fixed = first.map(([value, text]) => new Option(text, value));
      $(id).replaceChildren(...fixed, ...names.map((name) => new Option(name)));
      if ([...$(id).options].some((option) => option.value === chosen)) $(id).value = chosen;
    };
    fill("view", hello.views, []);
    fill("layer", hello.layers, [["", "radiance"]]);
    fill("policy", hello.policies, [["", "of the tracer"]]);
    fill("unit", hello.units, [["", "of the scene"]]);
    // A shader of the page's may ask for the time, too.
    this.player.offer({ animations: hello.animations, readsTime: hello.reads_time || this.player.readsTime });
    if (!this.camera) {
      this.camera = new Camera(hello.pose, hello.least, hello.greatest);
      this.showCamera();
    }
    this.tellAll();
  }

  /** Tells a new connection everything that differs from what it begins with. */
  tellAll() {
    const { edits, shaders, size, layer, scheduling, quality } = this.wanted;
    for (const [material, edit] of edits) this.connection.change({ type: "material", material, edit });
    for (const [material, source] of shaders) this.connection.change({ type: "shader", material, source });
    const { request: time } = this.player;
    for (const request of [size, quality, layer, scheduling, time]) if (request) this.connection.change(request);
    this.denoise();
    this.look();
    this.connection.change({ type: "camera", pose: this.camera.pose });
  }

  show(frame, bitmap) {
    const [width, height] = this.fullSize();
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.context.imageSmoothingQuality = "medium";
    this.context.drawImage(bitmap, 0, 0, width, height);
    $("shown-size").textContent = `${frame.width}×${frame.height}`;
    const frames = window.raystream.frames + 1;
    const { generation, sequence, moving, last, time, spp } = frame;
    Object.assign(window.raystream, { gen: generation, spp, frames, sequence, moving, last, time });
    $("spp").textContent = frame.spp;
    if (!frame.moving) $("progress").value = last ? 1 : frame.spp / Number($("target-spp").value);
    else $("progress").value = 0;
    this.canvas.dataset.generation = generation;
  }

  statistics(told) {
    $("state").textContent = told.state;
    const rate = told.state === "moving" ? told.frames_per_second : 0;
    $("fps").textContent = rate ? rate.toFixed(1) : "–";
    $("cpu-rays").textContent = brief.format(told.rays_per_second.cpu);
    $("gpu-rays").textContent = told.rays_per_second.gpu ? brief.format(told.rays_per_second.gpu) : "–";
    this.workers(told.workers);
  }

  /** Who rendered what of the last moving frame. Names come from other machines, so they are text. */
  workers(workers) {
    $("workers-panel").hidden = workers.length === 0;
    const cell = (text) => Object.assign(document.createElement("td"), { textContent: text });
    const row = ({ name, state, rows, ms, tiles, late }) => {
      const line = document.createElement("tr");
      line.dataset.state = state;
      line.title = state;
      line.append(cell(name), cell(rows), cell(ms.toFixed(1)), cell(brief.format(tiles)), cell(late));
      return line;
    };
    $("workers").replaceChildren(...workers.map(row));
  }

  takeTimeline(timeline) {
    this.lists.add(timeline.lists);
    this.timeline.show(timeline);
    $("wall").textContent = `${(timeline.wall_us / 1000).toFixed(1)} ms`;
  }

  /** At most one camera for each frame of the display. */
  moved() {
    this.showCamera();
    if (this.isSent) return;
    this.isSent = true;
    requestAnimationFrame(() => {
      this.isSent = false;
      this.connection.change({ type: "camera", pose: this.camera.pose });
    });
  }

  showCamera() {
    $("camera-flags").textContent = this.camera.flags();
    $("fov").disabled = this.camera.fov === null;
    if (this.camera.fov !== null) {
      $("fov").value = this.camera.fov;
      $("fov-value").textContent = `${Math.round(this.camera.fov)}°`;
    }
    if (document.activeElement !== $("aperture")) $("aperture").value = number(this.camera.lens?.radius ?? 0);
  }

  fullSize() {
    return $("size").value.split("x").map(Number);
  }

  pick([right, down], answer) {
    const [width, height] = this.fullSize();
    const [x, y] = [Math.floor(right * width), Math.floor(down * height)];
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const id = this.nextPick++;
    this.picks.set(id, { x, y, answer });
    this.connection.send({ type: "pick", id, x, y });
  }

  hover(place) {
    this.hovered = place;
    if (this.hoverTimer) return;
    this.hoverTimer = setTimeout(() => {
      this.hoverTimer = null;
      this.pick(this.hovered, () => {});
    }, 60);
  }

  picked({ id, hit, radiance }) {
    const { x, y, answer } = this.picks.get(id) ?? {};
    if (!answer) return;
    this.picks.delete(id);
    $("pick-pixel").textContent = `${x}, ${y}`;
    $("pick-radiance").textContent = radiance ? radiance.map((c) => c.toPrecision(3)).join(" ") : "–";
    $("pick-material").textContent = hit ? `${hit.material.name || "unnamed"} (${hit.material.kind})` : "none";
    $("pick-object").textContent = hit?.object || "–";
    $("pick-distance").textContent = hit ? number(hit.distance) : "∞";
    answer(hit);
  }

  focus(hit) {
    if (!hit) return;
    this.camera.focus(hit.position, hit.depth);
    this.moved();
  }

  select(hit) {
    if (!hit) return;
    const material = hit.material;
    this.selected = material.index;
    $("material-panel").open = true;
    $("material-fields").disabled = false;
    $("material-name").textContent = material.name || `number ${material.index}`;
    $("material-hint").textContent = material.textured
      ? "Textures multiply these values."
      : "Changes are shown at once; the tree stays.";
    for (const [id, value] of [["base-colour", material.base_colour], ["roughness", material.roughness],
      ["metallic", material.metallic]]) {
      $(id).disabled = value === null;
      if (value !== null) $(id).value = id === "base-colour" ? toHex(value) : value;
    }
    for (const id of ["roughness", "metallic"]) $(`${id}-value`).textContent = Number($(id).value).toFixed(2);
    $("emission").value = number(Math.max(...material.emission));
    $("shader").value = this.wanted.shaders.get(this.selected) ?? EXAMPLE;
    $("shader-error").hidden = true;
  }

  edit(change) {
    const material = this.selected;
    if (material === null) return;
    const edit = { ...this.wanted.edits.get(material), ...change };
    this.wanted.edits.set(material, edit);
    this.connection.change({ type: "material", material, edit: change });
  }

  attach(source) {
    const material = this.selected;
    if (material === null) return;
    if (source === null) this.wanted.shaders.delete(material);
    else this.wanted.shaders.set(material, source);
    this.connection.change({ type: "shader", material, source });
  }

  shaderAnswer({ material, error, reads_time: readsTime }) {
    this.player.offer({ readsTime });
    if (error) this.wanted.shaders.delete(material);
    $("shader-error").textContent = error ?? "";
    $("shader-error").hidden = !error;
  }

  look() {
    const exposure = $("auto-exposure").checked ? null : Number($("exposure").value);
    $("exposure").disabled = exposure === null;
    $("exposure-value").textContent = exposure === null ? "auto" : exposure.toFixed(1);
    this.connection.send({ type: "look", exposure, view: $("view").value || "agx" });
  }

  denoise() {
    this.connection.send({ type: "denoise", moving: $("denoise").checked });
  }

  /** Remembers a request that a new connection must be told, and sends it. */
  want(name, request) {
    this.wanted[name] = request;
    this.connection.change(request);
  }

  save(file) {
    const type = file.kind === "png" ? "image/png" : "image/x-exr";
    this.download(`raystream.${file.kind}`, type, file.bytes);
  }

  /** Saves the picture as data, and the shaders that it names. */
  saveSpec({ spec, shaders }) {
    this.download("raystream.json", "application/json", `${JSON.stringify(spec, null, 2)}\n`);
    for (const [name, text] of Object.entries(shaders)) this.download(name, "text/plain", text);
  }

  download(name, type, content) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([content], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  async copyCamera() {
    const flags = this.camera.flags();
    try {
      await navigator.clipboard.writeText(flags);
      this.notice(null);
      $("copy-camera").textContent = "Copied";
    } catch {
      // Browsers refuse it without a secure origin or permission: the flags are below the button.
      getSelection().selectAllChildren($("camera-flags"));
      $("copy-camera").textContent = "Selected below";
    }
    setTimeout(() => ($("copy-camera").textContent = "Copy flags"), 1500);
  }

  bind() {
    $("size").replaceChildren(...SIZES.map((size) => new Option(size.replace("x", "×"), size)));
    const on = (id, event, handler) => $(id).addEventListener(event, handler);
    const value = (id) => Number($(id).value);
    for (const id of ["view", "exposure", "auto-exposure"]) on(id, "input", () => this.look());
    on("layer", "input", () => this.want("layer", { type: "layer", layer: $("layer").value || null }));
    on("denoise", "input", () => this.denoise());
    on("fov", "input", () => {
      this.camera.fov = value("fov");
      this.moved();
    });
    on("aperture", "input", () => {
      this.camera.open(value("aperture"));
      this.moved();
    });
    on("frame-all", "click", () => this.act(() => this.camera.frameAll()));
    on("reset", "click", () => this.act(() => this.camera.reset()));
    on("copy-camera", "click", () => this.copyCamera());
    on("base-colour", "input", () => this.edit({ base_colour: fromHex($("base-colour").value) }));
    for (const id of ["roughness", "metallic"]) {
      on(id, "input", () => {
        $(`${id}-value`).textContent = value(id).toFixed(2);
        this.edit({ [id]: value(id) });
      });
    }
    on("emission", "change", () => this.edit({ emission: Array(3).fill(Math.max(0, value("emission"))) }));
    on("attach", "click", () => this.attach($("shader").value));
    on("detach", "click", () => this.attach(null));
    // While one writes, errors are told half a second after the last key.
    on("shader", "input", () => {
      clearTimeout(this.shaderTimer);
      this.shaderTimer = setTimeout(() => this.attach($("shader").value), 500);
    });
    const quality = () =>
      this.want("quality", { type: "quality", spp: value("target-spp"), max_bounces: value("bounces") });
    on("target-spp", "change", quality);
    on("bounces", "change", quality);
    on("size", "change", () => {
      const [width, height] = this.fullSize();
      this.want("size", { type: "size", width, height });
    });
    const scheduling = () =>
      this.want("scheduling", { type: "scheduling", policy: $("policy").value || null, unit: $("unit").value || null });
    on("policy", "change", scheduling);
    on("unit", "change", scheduling);
    on("save-png", "click", () => this.connection.send({ type: "save", format: "png" }));
    on("save-exr", "click", () => this.connection.send({ type: "save", format: "exr" }));
    on("save-spec", "click", () => this.connection.send({ type: "spec" }));
    new ResizeObserver(() => {
      this.lists.draw();
      this.timeline.draw();
    }).observe($("lists"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.lists.draw();
      this.timeline.draw();
    });
  }

  act(change) {
    if (!this.camera) return;
    change();
    this.moved();
    this.canvas.focus({ preventScroll: true });
  }
}
