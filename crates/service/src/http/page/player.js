// The time of a scene that moves: a slider, and a clock that plays.

const $ = (id) => document.getElementById(id);

/** What is played where a shader asks for the time and there is no animation. */
const SHADER_SPAN = { name: null, first: 0, last: 10 };

export class Player {
  /** `changed(request)` is called for each time that is to be shown. */
  constructor(changed) {
    this.changed = changed;
    this.animations = [];
    this.readsTime = false;
    /** The time that is shown in seconds; null is the scene at rest. */
    this.seconds = null;
    this.isPlaying = false;
    $("time").oninput = () => {
      // A pause draws the slider where the time was.
      const seconds = Number($("time").value);
      this.pause();
      this.show(seconds);
    };
    $("play").onclick = () => this.toggle();
    $("animation").oninput = () => this.show(this.span.first);
  }

  /** Says what can be played. */
  offer({ animations, readsTime }) {
    const chosen = $("animation").value;
    this.animations = animations ?? this.animations;
    this.readsTime = readsTime;
    $("animation").replaceChildren(...this.animations.map(({ name }) => new Option(name)));
    if (this.animations.some(({ name }) => name === chosen)) $("animation").value = chosen;
    $("animation").hidden = this.animations.length < 2;
    $("time-bar").hidden = !this.span;
    if (!this.span) this.stop();
    this.draw();
  }

  /** The animation that is chosen. */
  get span() {
    const chosen = this.animations[Math.max(0, $("animation").selectedIndex)];
    return chosen ?? (this.readsTime ? SHADER_SPAN : null);
  }

  /** The request for what is shown; null at rest. */
  get request() {
    if (this.seconds === null || !this.span) return null;
    return { type: "time", seconds: this.seconds, animation: this.span.name };
  }

  show(seconds) {
    this.seconds = seconds;
    this.draw();
    this.changed(this.request);
  }

  draw() {
    const span = this.span;
    if (!span) return;
    const seconds = this.seconds ?? span.first;
    Object.assign($("time"), { min: span.first, max: span.last });
    $("time").value = seconds;
    $("time-value").textContent = `${seconds.toFixed(2)} s`;
    $("play").textContent = this.isPlaying ? "Pause" : "Play";
    $("play").setAttribute("aria-pressed", this.isPlaying);
    Object.assign(window.raystream, { seconds: this.seconds, playing: this.isPlaying });
  }

  toggle() {
    if (this.isPlaying) this.pause();
    else this.play();
  }

  /** Plays from the time that is shown, over and over. The clock decides which time is next: slow frames skip some. */
  play() {
    if (this.isPlaying || !this.span) return;
    this.isPlaying = true;
    let before = performance.now();
    const step = (now) => {
      if (!this.isPlaying) return;
      const { first, last } = this.span;
      const passed = Math.max(0, now - before) / 1000;
      before = now;
      const length = last - first;
      const along = (this.seconds ?? first) - first + passed;
      this.show(length > 0 ? first + (along % length) : first);
      this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    this.draw();
  }

  pause() {
    this.isPlaying = false;
    cancelAnimationFrame(this.frame);
    this.draw();
  }

  /** Goes back to the scene at rest. */
  stop() {
    this.pause();
    if (this.seconds === null) return;
    this.seconds = null;
    this.changed({ type: "time", seconds: null });
  }
}
