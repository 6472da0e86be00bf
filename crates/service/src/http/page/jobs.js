// The list of jobs, and uploads.

import { request, upload } from "./http.js";

const POLL_MS = 1000;
const STEERED = { cancel: ["queued", "running", "paused"], retry: ["failed", "cancelled"] };
const ENDED = ["done", "failed", "cancelled"];

const $ = (id) => document.getElementById(id);

/** An element with a class, attributes and content. */
function element(name, attributes = {}, ...content) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...content);
  return made;
}

/** Seconds as people say them. */
function duration(seconds) {
  if (seconds < 120) return `${seconds} s`;
  return seconds < 7200 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds / 3600)} h`;
}

/** The SHA-256 of bytes in hexadecimal digits. */
async function sha256(bytes) {
  const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  return [...hash].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

export class Jobs {
  constructor() {
    this.shown = new Map();
    const drop = $("drop");
    for (const name of ["dragenter", "dragover"]) {
      drop.addEventListener(name, (event) => {
        event.preventDefault();
        drop.classList.add("over");
      });
    }
    for (const name of ["dragleave", "drop"]) drop.addEventListener(name, () => drop.classList.remove("over"));
    drop.addEventListener("drop", (event) => {
      event.preventDefault();
      this.send(event.dataTransfer.files[0]);
    });
    $("file").addEventListener("change", () => this.send($("file").files[0]));
  }

  /** Keeps the list up to date. */
  watch() {
    this.rest();
    this.timer = setInterval(() => this.update(), POLL_MS);
    this.update();
  }

  rest() {
    clearInterval(this.timer);
  }

  async update() {
    const answer = await request("GET", "jobs?limit=100");
    if (!answer.ok) return this.tell(answer.reason);
    const jobs = answer.body.jobs;
    $("no-jobs").hidden = jobs.length > 0;
    for (const [id, row] of this.shown) {
      if (!jobs.some((job) => job.id === id)) row.item.remove();
    }
    const rows = jobs.map((job) => this.row(job));
    // Rows that stay keep their place and with it the focus.
    rows.forEach((row, i) => {
      const there = $("job-list").children[i];
      if (there !== row.item) $("job-list").insertBefore(row.item, there ?? null);
    });
    this.shown = new Map(jobs.map((job, i) => [job.id, rows[i]]));
  }

  row(job) {
    const row = this.shown.get(job.id) ?? this.newRow(job);
    const percent = Math.floor(100 * job.progress);
    const left = job.left_s === null ? "" : `, ${duration(job.left_s)} left`;
    const state = job.state === "running" ? `running, ${percent} %${left}` : job.state;
    row.state.textContent = job.error ? `${state}: ${job.error}` : state;
    row.state.dataset.state = job.state;
    const { waiting, failed } = job.deliveries;
    row.calls.hidden = waiting + failed === 0 || !ENDED.includes(job.state);
    row.calls.textContent = failed > 0 ? `${failed} webhooks failed` : `${waiting} webhooks wait`;
    row.pin.textContent = job.pinned ? "Unpin" : "Pin";
    row.remove.hidden = job.pinned || !ENDED.includes(job.state);
    row.bar.value = job.progress;
    row.bar.hidden = job.state === "done";
    for (const [name, states] of Object.entries(STEERED)) row[name].hidden = !states.includes(job.state);
    if (job.frames_done > 0 && !row.picture.hasAttribute("src")) {
      row.picture.src = new URL(`api/v1/jobs/${job.id}/frames/0.png`, location.href);
      row.picture.hidden = false;
      row.save.hidden = false;
    }
    return row;
  }

  newRow(job) {
    const { id } = job;
    const picture = element("img", { class: "thumb", alt: "", loading: "lazy" });
    const bar = element("progress", { max: 1, "aria-label": `Progress of ${id}` });
    const state = element("div", { class: "state", "data-testid": "job-state" });
    const button = (text, action) => {
      const made = element("button", { type: "button", "data-testid": `job-${text.toLowerCase()}` }, text);
      made.addEventListener("click", action);
      return made;
    };
    const steer = (action) => async () => {
      const answer = await request("POST", `jobs/${id}/${action}`);
      if (!answer.ok) this.tell(answer.reason);
      this.update();
    };
    const [cancel, retry] = [button("Cancel", steer("cancel")), button("Retry", steer("retry"))];
    const pin = button("Pin", () => steer(pin.textContent.toLowerCase())());
    pin.title = "A pinned job is kept until someone deletes it";
    const remove = button("Delete", async () => {
      if (!confirm(`Delete job ${id} and its pictures?`)) return;
      const answer = await request("DELETE", `jobs/${id}`);
      if (!answer.ok) this.tell(answer.reason);
      this.update();
    });
    const view = element("a", { href: `#live=${job.scene}` }, "View");
    const save = element("a", { href: `api/v1/jobs/${id}/frames/0.png`, download: `${id}.png`, hidden: "" }, "Picture");
    const size = `${job.size[0]}×${job.size[1]}, ${job.spp} spp`;
    const words = [size, ...job.labels, new Date(job.created_ms).toLocaleString()].join(" · ");
    const title = job.title ?? size;
    const when = element("div", { class: "words" }, job.title ? words : words.slice(size.length + 3));
    const calls = element("div", { class: "words", "data-testid": "job-calls", hidden: "" });
    const heading = element("div", { class: "title" }, title);
    const about = element("div", { class: "about" }, heading, when, state, calls, bar);
    const buttons = element("div", { class: "buttons" }, view, save, cancel, retry, pin, remove);
    const item = element("li", { "data-testid": "job", "data-id": id }, picture, about, buttons);
    return { item, picture, bar, state, calls, cancel, retry, pin, remove, save };
  }

  tell(text) {
    $("upload").textContent = text;
  }

  /** Uploads a file and submits a job for it. */
  async send(file) {
    if (!file) return;
    if (!crypto.subtle) return this.tell("Uploads need HTTPS, or a page of this machine (localhost).");
    const bar = $("upload-progress");
    this.tell(`Reading ${file.name} …`);
    const bytes = await file.arrayBuffer();
    const hash = await sha256(bytes);
    const known = await request("GET", `scenes/${hash}`);
    if (!known.ok) {
      bar.hidden = false;
      this.tell(`Uploading ${file.name} …`);
      const sent = await upload(`scenes/${hash}`, bytes, "model/gltf-binary", (share) => (bar.value = share));
      bar.hidden = true;
      if (!sent.ok) return this.tell(`${file.name} was refused. ${sent.reason}`);
    }
    const spec = { scene: hash, size: "960x540", spp: 64, title: file.name.slice(0, 200) };
    const submitted = await request("POST", "jobs", { json: spec });
    this.tell(submitted.ok ? `${file.name} is being rendered.` : `${file.name} was refused. ${submitted.reason}`);
    $("file").value = "";
    this.update();
  }
}
