"use strict";
// Draws the events in [time - window, time) of each source as the sum of polarities of each pixel,
// on a plain ground, or over the last frame up to the time.

const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("events").textContent);
const controls = { play: byId("play"), time: byId("time"), window: byId("window"), slow: byId("slow") };

const blob = (base64) => new Blob([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))]);

// The columns of a source; see PackedEvents in player.py.
async function unpacked({ data: base64, count }) {
  const stream = blob(base64).stream().pipeThrough(new DecompressionStream("deflate"));
  const columns = await new Response(stream).arrayBuffer();
  const t = new Uint32Array(columns, 0, count);
  for (let k = 1; k < count; k++) t[k] += t[k - 1];
  return {
    t,
    x: new Uint16Array(columns, 4 * count, count),
    y: new Uint16Array(columns, 6 * count, count),
    brighter: new Uint8Array(columns, 8 * count, count),
  };
}

// The pictures behind a source; see PackedFrames in player_frames.py.
async function pictures({ frames }) {
  if (!frames) return null;
  const images = frames.images.map((base64) => createImageBitmap(blob(base64)));
  return { t: frames.t_us, images: await Promise.all(images) };
}

// Number of ascending times before a time.
function before(t, time) {
  let low = 0, high = t.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (t[middle] < time) low = middle + 1; else high = middle;
  }
  return low;
}

const mixed = (color, strength) => color.map((c, k) => Math.round(c * strength + data.ground[k] * (1 - strength)));
const most = data.strengths.length - 1;
const SUMS = Array.from({ length: 2 * most + 1 }, (_, k) => k - most);
const colorOf = (sum) => (sum > 0 ? data.brighter : data.darker);
const strengthOf = (sum) => data.strengths[Math.abs(sum)];
// Colors of the sums: mixed with the plain ground, or as opaque over a frame.
const ON_GROUND = SUMS.map((sum) => [...mixed(colorOf(sum), strengthOf(sum)), 255]);
const OVER_FRAME = SUMS.map((sum) => [...colorOf(sum), Math.round(255 * strengthOf(sum))]);
const word = (color) => new Uint32Array(Uint8Array.from(color).buffer)[0];

class Panel {
  constructor(figure, source, events, frames) {
    this.events = events;
    this.frames = frames;
    this.every = source.every;
    this.width = source.width;
    this.rate = figure.querySelector(".rate");
    this.canvas = figure.querySelector("canvas");
    this.brush = this.canvas.getContext("2d");
    this.layer = new OffscreenCanvas(source.width, source.height).getContext("2d");
    this.image = this.layer.createImageData(source.width, source.height);
    this.sums = new Int32Array(source.width * source.height);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.shades = (frames ? OVER_FRAME : ON_GROUND).map(word);
  }

  draw(start, end) {
    const { t, x, y, brighter } = this.events;
    const first = before(t, start), last = before(t, end);
    this.sums.fill(0);
    this.pixels.fill(this.shades[most]);
    for (let k = first; k < last; k++) {
      const pixel = y[k] * this.width + x[k];
      const sum = (this.sums[pixel] += brighter[k] ? 1 : -1);
      this.pixels[pixel] = this.shades[Math.max(-most, Math.min(most, sum)) + most];
    }
    this.layer.putImageData(this.image, 0, 0);
    if (this.frames) {
      const frame = this.frames.images[Math.max(0, before(this.frames.t, end + 1) - 1)];
      this.brush.drawImage(frame, 0, 0, this.canvas.width, this.canvas.height);
    }
    this.brush.drawImage(this.layer.canvas, 0, 0);
    const rate = ((last - first) * this.every) / Math.max(end - start, 1);
    this.rate.textContent = `${rate.toPrecision(3)} Mev/s`;
  }
}

class Player {
  constructor(panels) {
    this.panels = panels;
    this.playing = null;
    controls.time.max = data.duration_us;
    controls.time.value = Math.min(1000 * data.window_ms, data.duration_us);
    controls.window.value = nearest(controls.window, data.window_ms);
    controls.slow.value = nearest(controls.slow, 8e6 / data.duration_us);
    controls.time.addEventListener("input", () => { this.draw(); this.restart(); });
    controls.window.addEventListener("change", () => this.draw());
    controls.slow.addEventListener("change", () => this.restart());
    controls.play.addEventListener("click", () => this.toggle());
    document.addEventListener("keydown", (event) => this.key(event));
    this.draw();
  }

  get time() { return Number(controls.time.value); }
  get window() { return 1000 * Number(controls.window.value); }

  draw() {
    for (const panel of this.panels) panel.draw(this.time - this.window, this.time);
    const text = `${((data.start_us + this.time) / 1e6).toFixed(6)} s`;
    byId("clock").textContent = text;
    controls.time.setAttribute("aria-valuetext", text);
  }

  seek(time) {
    controls.time.value = Math.max(0, Math.min(data.duration_us, time));
    this.draw();
  }

  toggle() {
    if (this.playing) this.playing = null;
    else {
      if (this.time >= data.duration_us) this.seek(0);
      this.restart(true);
    }
    controls.play.textContent = this.playing ? "Pause" : "Play";
  }

  // Time runs from here; each picture is drawn at the time at which it is shown.
  restart(start = this.playing !== null) {
    if (!start) return;
    const mine = (this.playing = { from: this.time, since: performance.now(), slow: Number(controls.slow.value) });
    const step = (now) => {
      if (this.playing !== mine) return;
      const time = mine.from + (1000 * Math.max(0, now - mine.since)) / mine.slow;
      this.seek(time);
      if (time >= data.duration_us) this.toggle(); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  key(event) {
    if (event.target.matches("select") || event.ctrlKey || event.altKey || event.metaKey) return;
    const moves = { ArrowLeft: -1, ArrowRight: 1 }, lengths = { ArrowDown: -1, ArrowUp: 1 };
    if (event.key === " ") {
      this.toggle();
    } else if (event.key in moves) {
      this.seek(this.time + (moves[event.key] * this.window) / 2);
      this.restart();
    } else if (event.key in lengths) {
      const index = controls.window.selectedIndex + lengths[event.key];
      controls.window.selectedIndex = Math.max(0, Math.min(controls.window.options.length - 1, index));
      this.draw();
    } else return;
    event.preventDefault();
  }
}

// The value of a choice that is nearest to a number, by ratio.
function nearest(select, wanted) {
  const distance = (option) => Math.abs(Math.log(Number(option.value) / wanted));
  return [...select.options].reduce((best, option) => (distance(option) < distance(best) ? option : best)).value;
}

// Space on a focused button would also click it.
controls.play.addEventListener("keyup", (event) => { if (event.key === " ") event.preventDefault(); });

const loaded = data.sources.map((source) => Promise.all([unpacked(source), pictures(source)]));
Promise.all(loaded).then((parts) => {
  const figures = [...document.querySelectorAll("figure")];
  new Player(figures.map((figure, k) => new Panel(figure, data.sources[k], ...parts[k])));
  document.documentElement.dataset.ready = "true";
}).catch((error) => {
  byId("clock").textContent = `This browser cannot play the page: ${error.message}`;
});
