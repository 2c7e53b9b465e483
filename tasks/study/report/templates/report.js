// Draws each .plot from its JSON, updates the answer for the chosen bus, shows the plots of the
// chosen method, and enlarges previews.

const HEIGHT = 310, LEFT = 46, RIGHT = 12, TOP = 12, BOTTOM = 268; // of a panel; BOTTOM is the x axis
const ROOM = 12, LABEL_ROOM = 26; // above and below the data, without and with series labels

const bus = document.getElementById("bus");

function svg(parent, name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent?.append(element);
  return element;
}

const color = (key) => `var(--${key.color})`;
const outline = (key) => `M${key.mark.map((corner) => corner.join(" ")).join("L")}Z`;
const joined = (line) => line.points.map((p) => [p.x, p.y]);
const placesOf = (line) => [...(line.path ?? []), ...joined(line)];
const scaled = (axis, value) => (axis.log ? Math.log10(value) : value);

// Range of the values on a scaled axis, with a fraction of the range added at each end.
function domain(axis, values, share) {
  const reached = [...values, ...axis.include].map((value) => scaled(axis, value));
  if (!reached.length) return [0, 1];
  const low = Math.min(...reached), high = Math.max(...reached);
  const pad = (high - low || 1) * share;
  return [low - pad, high + pad];
}

// The finest ticks of an axis with at most `most` labels in the range.
function ticksWithin(axis, [low, high]) {
  const inside = ([at]) => at >= low && at <= high;
  const sets = axis.ticks.map((ticks) => ticks.map(([v, label]) => [scaled(axis, v), label]).filter(inside));
  return sets.find((ticks) => ticks.filter(([, label]) => label).length <= axis.most) ?? sets.at(-1);
}

class Plot {
  constructor(root) {
    this.data = JSON.parse(root.querySelector("script").textContent);
    this.panels = root.querySelector(".panels");
    this.keys = [...root.querySelectorAll(".key")];
    this.zoom = root.querySelector(".zoom");
    this.figures = [...root.querySelectorAll(".drawn")].map((figure, i) => (
      { panel: this.data.panels[i], box: figure.querySelector("div"), tip: figure.querySelector(".tip"), stop: 0 }
    ));
    this.keys.forEach((key, series) => {
      key.addEventListener("pointerenter", () => this.emphasize(series));
      key.addEventListener("pointerleave", () => this.emphasize());
    });
    root.querySelector(".controls").addEventListener("change", () => this.draw());
    new ResizeObserver(() => requestAnimationFrame(() => this.draw())).observe(this.panels); // draws at once
  }

  emphasize(series) {
    for (const group of this.panels.querySelectorAll(".series"))
      group.classList.toggle("on", Number(group.dataset.series) === series);
  }

  heights(panels) {
    const shown = panels.flatMap((panel) => panel.lines.filter((_, series) => this.keys[series].control.checked));
    const values = [...shown.flatMap(placesOf).map(([, y]) => y), ...panels.flatMap((p) => p.references)];
    const room = this.data.keys.some((key) => key.label) ? LABEL_ROOM : ROOM;
    return domain(this.data.y, values, room / (BOTTOM - TOP - 2 * room));
  }

  draw() {
    const every = this.data.panels;
    const widths = every.flatMap((panel) => panel.lines.flatMap(placesOf)).map(([x]) => x);
    for (const one of this.figures) {
      one.width = one.box.clientWidth;
      const shared = this.zoom?.control.checked ? [one.panel] : every;
      if (one.width) this.drawPanel(one, domain(this.data.x, widths, 0.06), this.heights(shared), this.limit());
    }
  }

  // The limit on x: the bus that the reader chose, or that of the data.
  limit() {
    const { limit } = this.data;
    return limit && bus?.value ? { x: Number(bus.value), label: `bus ${bus.value} Mev/s` } : limit;
  }

  drawPanel(one, xDomain, yDomain, limit) {
    const { panel, box, tip, width } = one;
    const { title, keys, x: xAxis, y: yAxis, labels_below: below } = this.data;
    const right = width - RIGHT;
    const across = (at) => LEFT + ((at - xDomain[0]) / (xDomain[1] - xDomain[0])) * (right - LEFT);
    const up = (at) => BOTTOM - ((at - yDomain[0]) / (yDomain[1] - yDomain[0])) * (BOTTOM - TOP);
    const x = (value) => across(scaled(xAxis, value)), y = (value) => up(scaled(yAxis, value));
    const dashed = panel.references.length ? `Dashed line: ${panel.reference_label}. ` : "";
    const isBeyond = limit && x(limit.x) < right;
    const shaded = isBeyond ? `Shaded: beyond the ${limit.label}. ` : "";
    const label = `${title}, ${panel.label} (${panel.detail}): ${yAxis.label} against ${xAxis.label}. ${dashed}${shaded}Arrow keys move from point to point.`;
    const root = svg(null, "svg", { viewBox: `0 0 ${width} ${HEIGHT}`, height: HEIGHT, role: "group", "aria-label": label });
    const line = (kind, x1, x2, y1, y2, opacity = 1) => svg(root, "line", { class: kind, x1, x2, y1, y2, "stroke-opacity": opacity });
    const text = (words, x, y, anchor = "middle") => svg(root, "text", { x, y, "text-anchor": anchor }, words);
    svg(root, "rect", { class: "frame", x: LEFT, y: TOP, width: right - LEFT, height: BOTTOM - TOP });
    for (const [at, words] of ticksWithin(yAxis, yDomain)) {
      line("grid", LEFT, right, up(at), up(at), words ? 1 : 0.45);
      text(words, LEFT - 6, up(at) + 4, "end");
    }
    for (const [at, words] of ticksWithin(xAxis, xDomain)) {
      line("grid", across(at), across(at), TOP, BOTTOM, words ? 1 : 0.45);
      text(words, across(at), BOTTOM + 15);
    }
    text(xAxis.label, (LEFT + right) / 2, HEIGHT - 8);
    text(yAxis.label, 0, 0).setAttribute("transform", `translate(11 ${(TOP + BOTTOM) / 2}) rotate(-90)`);
    for (const value of panel.references) line("baseline", LEFT, right, y(value), y(value));
    if (panel.references.length) {
      const at = below ? TOP + 11 : BOTTOM - 9; // on the side without series labels
      line("baseline", right - 30, right - 6, at, at);
      text(panel.reference_label, right - 36, at + 4, "end").setAttribute("class", "halo");
    }
    if (isBeyond) {
      const from = Math.max(x(limit.x), LEFT), upright = `translate(${from - 4} ${below ? TOP + 22 : BOTTOM - 22}) rotate(-90)`;
      svg(root, "rect", { class: "beyond", x: from, y: TOP, width: right - from, height: BOTTOM - TOP });
      line("limit", from, from, TOP, BOTTOM);
      svg(root, "text", { class: "halo", transform: upright, "text-anchor": below ? "end" : "start" }, limit.label);
    }
    const places = [];
    keys.forEach((key, series) => {
      const { points, path } = panel.lines[series], way = path ?? joined(panel.lines[series]);
      if (!this.keys[series].control.checked || !way.length) return;
      const group = svg(root, "g", { class: "series", "data-series": series });
      svg(group, "path", { class: "line", d: `M${way.map((at) => `${x(at[0])} ${y(at[1])}`).join("L")}`, stroke: color(key) });
      for (const point of points) {
        const place = { series, lines: point.lines, x: x(point.x), y: y(point.y) };
        place.mark = svg(group, "path", {
          class: "mark", d: outline(key), transform: `translate(${place.x} ${place.y})`, fill: color(key),
          role: "img", tabindex: -1, "aria-label": point.lines.join(", "),
        });
        places.push(place);
      }
      if (!key.label || !points.length) return;
      const at = { x: x(points[0].x), y: y(points[0].y) + (below ? 18 : -10), "text-anchor": "middle", "aria-hidden": true };
      svg(group, "text", { ...at, style: `fill: color-mix(in srgb, ${color(key)} 62%, var(--ink))` }, key.label);
    });
    const ring = svg(root, "circle", { class: "ring", r: 9, visibility: "hidden" });
    const hadFocus = box.contains(document.activeElement);
    box.replaceChildren(root);
    tip.hidden = true;
    if (!places.length) return;

    let current;
    const show = (place) => {
      if (place === current) return;
      current = place;
      tip.hidden = !place;
      ring.setAttribute("visibility", place ? "visible" : "hidden");
      this.emphasize(place?.series);
      if (!place) return;
      ring.setAttribute("transform", `translate(${place.x} ${place.y})`);
      tip.textContent = place.lines.join("\n");
      const above = box.offsetTop + place.y - tip.offsetHeight - 14;
      tip.style.left = `${Math.min(Math.max(place.x - tip.offsetWidth / 2, 0), width - tip.offsetWidth)}px`;
      tip.style.top = `${above > 0 ? above : box.offsetTop + place.y + 14}px`;
    };
    const pick = (event) => {
      const frame = root.getBoundingClientRect();
      const away = places.map((p) => Math.hypot(p.x - event.clientX + frame.left, p.y - event.clientY + frame.top));
      show(places[away.indexOf(Math.min(...away, 32))]);
    };
    root.addEventListener("pointermove", pick);
    root.addEventListener("pointerdown", pick);
    root.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && show());
    // The Tab key stops at one point of a panel; arrow keys move from there.
    places.forEach((place, index) => {
      place.mark.addEventListener("focus", () => {
        places[one.stop].mark.tabIndex = -1;
        place.mark.tabIndex = 0;
        one.stop = index;
        show(place);
      });
      place.mark.addEventListener("blur", () => show());
    });
    root.addEventListener("keydown", (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey) return; // those of the browser
      const next = (one.stop + 1) % places.length, before = one.stop - 1; // -1 is the last
      const to = { ArrowRight: next, ArrowDown: before, ArrowUp: next, ArrowLeft: before, Home: 0, End: -1 }[event.key];
      if (event.key === "Escape") show();
      if (to === undefined) return;
      event.preventDefault();
      places.at(to).mark.focus();
    });
    one.stop = Math.min(one.stop, places.length - 1);
    places[one.stop].mark.tabIndex = 0;
    if (hadFocus) places[one.stop].mark.focus();
  }
}

const plots = [...document.querySelectorAll(".plot")].map((root) => new Plot(root));

// Shows the width that is enough on the chosen bus in each cell of the answer.
const cells = [...document.querySelectorAll(".matrix td")].map((cell) => (
  { cell, over: cell.classList.contains("over"), shown: JSON.parse(cell.dataset.shown) }
));
function answer() {
  for (const { cell, over, shown } of cells) {
    const [width, facts, fineness] = shown[bus.selectedIndex], tied = cell.querySelector("i");
    cell.querySelector("b").textContent = width;
    cell.querySelector("small").textContent = facts;
    cell.style.setProperty("--fine", fineness);
    cell.classList.toggle("over", over && !bus.value);
    if (tied) tied.hidden = Boolean(bus.value);
  }
}
if (bus) { // without one, events went through the buses of the study
  bus.addEventListener("change", () => (answer(), plots.forEach((plot) => plot.draw())));
  answer(); // a browser may restore an earlier choice
}

const pick = document.getElementById("pick");
const choose = () =>
  document.querySelectorAll(".plots").forEach((group, i) => (group.hidden = i !== Number(pick.value)));
pick?.addEventListener("change", choose);
if (pick) choose(); // a browser may restore an earlier choice

const zoom = document.getElementById("zoom");
document.querySelectorAll(".shot").forEach((button) =>
  button.addEventListener("click", () => {
    const { src, alt, className } = button.querySelector("img");
    Object.assign(zoom.querySelector("img"), { src, alt, className });
    zoom.querySelector("p").textContent = alt;
    zoom.showModal();
  }),
);
zoom.addEventListener("click", (event) => event.target === zoom && zoom.close());
