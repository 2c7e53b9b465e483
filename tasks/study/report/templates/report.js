"use strict";
// Draws the trade-off plots from the JSON in #plot-data, shows those of the chosen method, and
// enlarges previews.

const SVG = "http://www.w3.org/2000/svg";
const MARKS = [
  "M4.5 0A4.5 4.5 0 1 1-4.5 0A4.5 4.5 0 1 1 4.5 0Z",
  "M-4-4H4V4H-4Z",
  "M0-5.2L5 3.8H-5Z",
  "M0-5.6L5.2 0L0 5.6L-5.2 0Z",
  "M0 5.2L5-3.8H-5Z",
];
const HEIGHT = 310;
const MARGIN = { left: 46, right: 12, top: 12, bottom: 42 };
const LABEL_ROOM = 26; // at one end for the label of a width, at the other for that of the dashed line

function svg(name, attributes, parent, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  if (parent) parent.append(element);
  return element;
}

function html(name, properties, parent) {
  const element = Object.assign(document.createElement(name), properties);
  if (parent) parent.append(element);
  return element;
}

const colour = (series) => `var(--series-${series % 8})`;
const inkOf = (series) => `color-mix(in srgb, ${colour(series)} 62%, var(--ink))`; // to be read
const mark = (series) => MARKS[series % MARKS.length];

function extent(values, share) {
  const low = Math.min(...values), high = Math.max(...values);
  const pad = (high - low || 1) * share;
  return [low - pad, high + pad];
}

function niceTicks([low, high], count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  const ticks = [];
  for (let t = Math.ceil(low / step) * step; t <= high; t += step) ticks.push([t, t.toFixed(digits).replace("-", "−")]);
  return ticks;
}

function logTicks([low, high], every = false) {
  const ticks = [];
  const narrow = every && high - low < 0.7;
  for (let decade = Math.floor(low); decade <= high; decade++)
    for (const m of narrow ? [1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9] : [1, 2, 5]) {
      const at = decade + Math.log10(m);
      const label = m === 1 || every ? String(Number((m * 10 ** decade).toPrecision(2))) : "";
      if (at >= low && at <= high) ticks.push([at, label]);
    }
  return ticks;
}

class Plot {
  constructor(root, data) {
    this.root = root;
    this.data = data;
    this.hidden = new Set();
    this.shared = true;
    this.controls();
    this.panels = html("div", { className: "panels" }, root);
    this.figures = data.panels.map((panel) => {
      const figure = html("figure", { className: "panel" }, this.panels);
      const caption = html("figcaption", { textContent: `${panel.label} ` }, figure);
      html("small", { textContent: panel.detail }, caption);
      const box = html("div", {}, figure);
      const tip = html("div", { className: "tip", hidden: true }, figure);
      tip.setAttribute("aria-hidden", "true"); // its words are the label of the point it is for
      return { figure, box, tip, panel };
    });
    this.draw();
    new ResizeObserver(() => requestAnimationFrame(() => this.draw())).observe(this.panels);
  }

  controls() {
    const bar = html("div", { className: "controls" }, this.root);
    this.data.widths.forEach((width, series) => {
      const button = html("button", { type: "button" }, bar);
      const key = svg("svg", { width: 12, height: 12, viewBox: "-6 -6 12 12", "aria-hidden": true }, button);
      svg("path", { d: mark(series), fill: colour(series) }, key);
      button.append(`${width} px`);
      button.setAttribute("aria-pressed", "true");
      button.addEventListener("click", () => {
        if (!this.hidden.delete(series)) this.hidden.add(series);
        button.setAttribute("aria-pressed", String(!this.hidden.has(series)));
        this.draw(true);
      });
      button.addEventListener("pointerenter", () => this.emphasise(series));
      button.addEventListener("pointerleave", () => this.emphasise(null));
    });
    const axis = html("button", { type: "button", className: "axis", textContent: "Zoom each panel" }, bar);
    axis.setAttribute("aria-pressed", "false");
    axis.addEventListener("click", () => {
      this.shared = !this.shared;
      axis.setAttribute("aria-pressed", String(!this.shared));
      this.draw(true);
    });
  }

  emphasise(series) {
    this.panels.classList.toggle("focus", series !== null && !this.hidden.has(series));
    for (const group of this.panels.querySelectorAll(".series"))
      group.classList.toggle("on", Number(group.dataset.series) === series);
  }

  height(score) {
    return this.data.log ? Math.log10(score) : score;
  }

  heights(panels) {
    const points = panels.flatMap((p) => p.points.filter((q) => !this.hidden.has(q.series)));
    const scores = [...points.map((q) => q.score), ...panels.flatMap((p) => p.baselines)];
    const values = scores.map((score) => this.height(score));
    const share = LABEL_ROOM / (HEIGHT - MARGIN.top - MARGIN.bottom - 2 * LABEL_ROOM);
    return values.length ? extent(values, share) : [0, 1];
  }

  draw(force) {
    const all = this.data.panels;
    const rates = all.flatMap((p) => p.points.map((q) => Math.log10(q.rate)));
    const xDomain = rates.length ? extent(rates, 0.06) : [0, 1];
    for (const one of this.figures) {
      const width = one.box.clientWidth;
      if (!width || (one.width === width && !force)) continue;
      one.width = width;
      this.drawPanel(one, width, xDomain, this.heights(this.shared ? all : [one.panel]));
    }
  }

  drawPanel(one, width, xDomain, yDomain) {
    const { panel, box, tip } = one;
    const right = width - MARGIN.right, bottom = HEIGHT - MARGIN.bottom;
    const x = (v) => MARGIN.left + ((v - xDomain[0]) / (xDomain[1] - xDomain[0])) * (right - MARGIN.left);
    const y = (v) => bottom - ((v - yDomain[0]) / (yDomain[1] - yDomain[0])) * (bottom - MARGIN.top);
    const root = svg("svg", { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT, role: "group" });
    root.setAttribute("aria-label", `${this.data.title}, ${panel.label} (${panel.detail}): ${this.data.axis} against event rate. Dashed line: ${panel.baseline_label}. Arrow keys go from point to point.`);
    svg("rect", { class: "frame", x: MARGIN.left, y: MARGIN.top, width: right - MARGIN.left, height: bottom - MARGIN.top }, root);
    const ticks = this.data.log ? logTicks(yDomain, true) : niceTicks(yDomain, 9);
    for (const [at, label] of ticks) {
      svg("line", { class: "grid", x1: MARGIN.left, x2: right, y1: y(at), y2: y(at) }, root);
      svg("text", { x: MARGIN.left - 6, y: y(at) + 4, "text-anchor": "end" }, root, label);
    }
    for (const [at, label] of logTicks(xDomain)) {
      svg("line", { class: "grid", x1: x(at), x2: x(at), y1: MARGIN.top, y2: bottom, "stroke-opacity": label ? 1 : 0.45 }, root);
      svg("text", { x: x(at), y: bottom + 15, "text-anchor": "middle" }, root, label);
    }
    svg("text", { x: (MARGIN.left + right) / 2, y: HEIGHT - 8, "text-anchor": "middle" }, root, "event rate [Mev/s]");
    svg("text", { transform: `translate(11 ${(MARGIN.top + bottom) / 2}) rotate(-90)`, "text-anchor": "middle" }, root, this.data.axis);
    for (const score of panel.baselines)
      svg("line", { class: "baseline", x1: MARGIN.left, x2: right, y1: y(this.height(score)), y2: y(this.height(score)) }, root);
    if (panel.baselines.length) {
      const at = this.data.less_is_better ? MARGIN.top + 11 : bottom - 9; // where no width's label is
      svg("line", { class: "baseline", x1: right - 30, x2: right - 6, y1: at, y2: at }, root);
      svg("text", { x: right - 36, y: at + 4, "text-anchor": "end" }, root, panel.baseline_label);
    }
    const places = [];
    this.data.widths.forEach((px, series) => {
      if (this.hidden.has(series)) return;
      const points = panel.points.filter((q) => q.series === series);
      if (!points.length) return;
      const group = svg("g", { class: "series", "data-series": series }, root);
      const placed = points.map((q) => ({ q, x: x(Math.log10(q.rate)), y: y(this.height(q.score)) }));
      svg("path", { class: "line", d: `M${placed.map((p) => `${p.x} ${p.y}`).join("L")}`, stroke: colour(series) }, group);
      for (const p of placed) {
        p.mark = svg("path", { class: "mark", d: mark(series), transform: `translate(${p.x} ${p.y})`, fill: colour(series), role: "img", tabindex: -1 }, group);
        p.mark.setAttribute("aria-label", p.q.lines.join(", "));
      }
      const first = placed[0];
      svg("text", { x: first.x, y: first.y + (this.data.less_is_better ? 18 : -10), "text-anchor": "middle", "aria-hidden": true, style: `fill:${inkOf(series)}` }, group, px);
      places.push(...placed);
    });
    const ring = svg("circle", { class: "ring", r: 9, visibility: "hidden" }, root);
    const hadFocus = box.contains(document.activeElement);
    box.replaceChildren(root);
    tip.hidden = true;

    // One point of a panel is a stop of the Tab key, arrow keys go on from it.
    let stop = Math.max(0, Math.min(one.stop ?? 0, places.length - 1));
    const stopAt = (index) => {
      places[stop].mark.setAttribute("tabindex", -1);
      one.stop = stop = index;
      places[stop].mark.setAttribute("tabindex", 0);
    };
    let current = -1;
    const show = (index) => {
      current = index;
      const p = places[index];
      tip.hidden = !p;
      ring.setAttribute("visibility", p ? "visible" : "hidden");
      this.emphasise(p ? p.q.series : null);
      if (!p) return;
      ring.setAttribute("cx", p.x);
      ring.setAttribute("cy", p.y);
      tip.replaceChildren(html("b", { textContent: p.q.lines[0] }));
      for (const line of p.q.lines.slice(1)) html("div", { textContent: line }, tip);
      const left = Math.min(Math.max(p.x - tip.offsetWidth / 2, 0), width - tip.offsetWidth);
      const above = box.offsetTop + p.y - tip.offsetHeight - 14;
      tip.style.left = `${left}px`;
      tip.style.top = `${above > 0 ? above : box.offsetTop + p.y + 14}px`;
    };
    const pick = (event) => {
      const frame = root.getBoundingClientRect();
      const px = event.clientX - frame.left, py = event.clientY - frame.top;
      let best = -1, nearest = 32;
      places.forEach((p, i) => {
        const distance = Math.hypot(p.x - px, p.y - py);
        if (distance < nearest) [nearest, best] = [distance, i];
      });
      if (best !== current) show(best);
    };
    root.addEventListener("pointermove", pick);
    root.addEventListener("pointerdown", pick);
    root.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && show(-1));
    places.forEach((p, i) => {
      p.mark.addEventListener("focus", () => {
        stopAt(i);
        show(i);
      });
      p.mark.addEventListener("blur", () => show(-1));
    });
    root.addEventListener("keydown", (event) => {
      const last = places.length - 1;
      const to = {
        ArrowRight: stop < last ? stop + 1 : 0,
        ArrowLeft: stop > 0 ? stop - 1 : last,
        Home: 0,
        End: last,
      };
      to.ArrowUp = to.ArrowRight;
      to.ArrowDown = to.ArrowLeft;
      if (event.key === "Escape") show(-1);
      if (!(event.key in to)) return;
      event.preventDefault();
      places[to[event.key]].mark.focus();
    });
    if (places.length) stopAt(stop);
    if (places.length && hadFocus) places[stop].mark.focus();
  }
}

const plots = JSON.parse(document.getElementById("plot-data").textContent);
const drawn = [...document.querySelectorAll(".plot")].map((root, i) => new Plot(root, plots[i]));

const pick = document.getElementById("pick");
if (pick) {
  const groups = document.querySelectorAll(".plots");
  const choose = () => {
    groups.forEach((group, i) => (group.hidden = i !== Number(pick.value)));
    drawn.forEach((plot) => plot.draw()); // those that were hidden had no width
  };
  pick.addEventListener("change", choose);
  choose(); // a browser may restore an earlier choice
}

const zoom = document.getElementById("zoom");
document.querySelectorAll(".shot").forEach((button) =>
  button.addEventListener("click", () => {
    const small = button.querySelector("img"), large = zoom.querySelector("img");
    large.src = small.src;
    large.alt = small.alt;
    large.className = small.className;
    zoom.querySelector("p").textContent = small.alt;
    zoom.showModal();
  }),
);
zoom.addEventListener("click", (event) => event.target === zoom && zoom.close());
