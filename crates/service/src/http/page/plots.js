// Plots of what the scheduler does: the lists over time, and the tasks of the last frame (RA Figure 7).

const MOST = 600;

/** A canvas with as many pixels as the display has, cleared. */
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

function colours(names) {
  const style = getComputedStyle(document.documentElement);
  return names.map((name) => style.getPropertyValue(`--${name}`).trim());
}

/** The lists' lengths over the last frames, stacked. */
export class ListPlot {
  constructor(canvas) {
    this.canvas = canvas;
    this.samples = [];
  }

  add(lists) {
    this.samples.push(...lists.map((l) => [l.shade, l.trace, l.need_more, l.empty]));
    this.samples.splice(0, Math.max(0, this.samples.length - MOST));
    this.draw();
  }

  draw() {
    const { context, width, height } = prepared(this.canvas);
    if (!this.samples.length) return;
    const sums = this.samples.map((sample) => sample.reduce((a, b) => a + b, 0));
    const most = Math.max(...sums, 1);
    const x = (i) => width - ((this.samples.length - 1 - i) * width) / (MOST - 1);
    const paint = colours(["shade", "trace", "needmore", "empty"]);
    const below = this.samples.map(() => 0);
    for (let list = 0; list < 4; list++) {
      context.fillStyle = paint[list];
      context.beginPath();
      this.samples.forEach((_, i) => context.lineTo(x(i), height - (below[i] * height) / most));
      this.samples.forEach((sample, i) => (below[i] += sample[list]));
      for (let i = this.samples.length - 1; i >= 0; i--) context.lineTo(x(i), height - (below[i] * height) / most);
      context.fill();
    }
    context.fillStyle = colours(["quiet"])[0];
    context.font = "10px system-ui";
    context.fillText(String(most), 1, 9);
  }
}

/** The tasks of each thread during one frame. */
export class TimelinePlot {
  constructor(canvas) {
    this.canvas = canvas;
    this.timeline = null;
  }

  show(timeline) {
    this.timeline = timeline;
    this.draw();
  }

  draw() {
    const { context, width, height } = prepared(this.canvas);
    if (!this.timeline) return;
    const { threads, tasks, wall_us } = this.timeline;
    const used = [...new Set(tasks.map((task) => task[0]))].sort((a, b) => a - b);
    const label = width > 260 ? 62 : 0;
    const row = Math.min(26, height / Math.max(1, used.length));
    const paint = colours(["spawn", "shade", "trace", "dispatch", "resolve"]);
    const scale = (width - label) / Math.max(1, wall_us);
    const quiet = colours(["quiet"])[0];
    context.font = "10px system-ui";
    used.forEach((thread, index) => {
      context.fillStyle = quiet;
      if (label) context.fillText(threads[thread] ?? String(thread), 0, index * row + row / 2 + 3);
    });
    for (const [thread, kind, start, end] of tasks) {
      context.fillStyle = paint[kind];
      const y = used.indexOf(thread) * row + 1;
      context.fillRect(label + start * scale, y, Math.max(0.6, (end - start) * scale), Math.max(1, row - 3));
    }
  }
}
