"use strict";

// ---- values of a map ----------------------------------------------------------------------------

const bytesOf = base64 => Uint8Array.from(atob(base64), sign => sign.charCodeAt(0));
const known = new Map();

function valuesOf(id) {
  if (!known.has(id)) {
    const map = JSON.parse(document.getElementById(id).textContent);
    for (const layer of map.layers) layer.values = new Float32Array(bytesOf(layer.values).buffer);
    map.reasons = map.reasons && bytesOf(map.reasons);
    known.set(id, map);
  }
  return known.get(id);
}

const printed = (value, digits) => value.toFixed(digits).replace("-", "\u2212");

function coordinateDigits(map) {
  return Math.max(0, 1 + Math.ceil(-Math.log10(map.step[0])));
}

// ---- flat maps: read under the pointer, or at a place that arrow keys move -----------------------

class Probe {
  constructor(field) {
    this.field = field;
    this.map = valuesOf(field.dataset.values);
    this.limits = field.dataset.limits.split(" ").map(Number);
    this.output = document.getElementById(field.getAttribute("aria-describedby"));
    this.node = null;
    for (const line of ["across", "down"]) this[line] = field.appendChild(this.line(line));
    field.hidden = this.output.hidden = false;
    this.output.textContent = "Point at the map to read it; arrow keys move the place.";
    field.addEventListener("pointermove", event => this.point(event));
    field.addEventListener("pointerdown", event => this.point(event));
    field.addEventListener("keydown", event => this.step(event));
  }

  line(name) {
    const line = document.createElement("i");
    line.className = name;
    line.hidden = true;
    return line;
  }

  // Share of the field's width, or height, at which a node lies.
  share(axis, node) {
    const [from, to] = this.limits.slice(2 * axis, 2 * axis + 2);
    return (this.map.start[axis] + node * this.map.step[axis] - from) / (to - from);
  }

  nodeAt(axis, share) {
    const [from, to] = this.limits.slice(2 * axis, 2 * axis + 2);
    const node = Math.round((from + share * (to - from) - this.map.start[axis]) / this.map.step[axis]);
    return Math.min(Math.max(node, 0), this.map.size[axis] - 1);
  }

  point(event) {
    const place = this.field.getBoundingClientRect();
    const shares = [(event.clientX - place.left) / place.width, (event.clientY - place.top) / place.height];
    this.show(shares.map((share, axis) => this.nodeAt(axis, share)));
  }

  step(event) {
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (!(event.key in moves)) return;
    event.preventDefault();
    const middle = this.map.size.map(size => Math.floor(size / 2));
    const far = event.shiftKey ? 10 : 1;
    const now = this.node ?? middle;
    this.show(moves[event.key].map((move, axis) => {
      // Down on the screen is up in numbers where the limits run from high to low.
      const sign = Math.sign(this.limits[2 * axis + 1] - this.limits[2 * axis]);
      return Math.min(Math.max(now[axis] + sign * far * move, 0), this.map.size[axis] - 1);
    }));
    this.across.scrollIntoView({ block: "nearest", inline: "nearest" });
  }

  show(node) {
    this.node = node;
    this.down.style.left = `${100 * this.share(0, node[0])}%`;
    this.across.style.top = `${100 * this.share(1, node[1])}%`;
    this.down.hidden = this.across.hidden = false;
    this.output.textContent = this.words();
  }

  words() {
    const { map, node } = this;
    const place = node[1] * map.size[0] + node[0];
    const digits = coordinateDigits(map);
    const where = map.coordinates.map(
      (name, axis) => `${name} ${printed(map.start[axis] + node[axis] * map.step[axis], digits)} ${map.unit}`);
    const found = map.layers.filter(layer => !Number.isNaN(layer.values[place]))
      .map(layer => `${layer.name} ${printed(layer.values[place], layer.digits)} ${layer.unit}`);
    const reason = map.reasons && map.reasons[place] ? ` (${map.reasonNames[map.reasons[place] - 1]})` : "";
    return `${where.join(", ")}: ${found.length ? found.join(", ") : `no value${reason}`}`;
  }
}

// ---- surfaces: turned in three dimensions, drawn by Plotly ---------------------------------------

const NARROW_PX = 600;

async function loadPlotly() {
  if (window.Plotly) return;
  const packed = new Blob([bytesOf(document.getElementById("plotly").textContent)]).stream();
  const script = document.createElement("script");
  script.text = await new Response(packed.pipeThrough(new DecompressionStream("gzip"))).text();
  document.head.append(script);
}

function rowsOf(map, layer, print) {
  const [columns, rows] = map.size;
  return Array.from({ length: rows }, (_, row) =>
    Array.from(layer.values.subarray(row * columns, (row + 1) * columns), print));
}

function spanOf(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return high - low;
}

class Stage {
  constructor(place) {
    this.place = place;
    this.map = valuesOf(place.dataset.values);
    this.stretch = Number(place.dataset.stretch);
    this.view = { x: 0.65, y: -1.4, z: 0.95 };
    const figure = place.closest("figure");
    this.picture = figure.querySelector(".box");
    this.output = figure.querySelector("output");
    this.button = figure.querySelector(".turn");
    this.button.hidden = false;
    this.button.addEventListener("click", () => this.toggle());
    place.addEventListener("keydown", event => this.key(event));
    // A stage that is not shown, as on paper, has no size to draw for.
    new ResizeObserver(() => this.drawn && place.offsetWidth && Plotly.Plots.resize(place)).observe(place);
  }

  async toggle() {
    const turning = this.place.hidden;
    this.place.hidden = !turning;
    this.picture.classList.toggle("resting", turning);
    this.button.setAttribute("aria-pressed", turning);
    this.output.hidden = !turning;
    this.output.textContent = "Drag to turn, scroll or pinch to come closer; arrow keys, plus, minus and Home do the same.";
    if (turning && !this.drawn) await this.draw().catch(error => this.fail(error));
  }

  fail(error) {
    this.place.hidden = true;
    this.picture.classList.remove("resting");
    this.button.hidden = true;
    this.output.textContent = `This browser cannot turn the surface: ${error.message}`;
  }

  async draw() {
    const canvas = document.createElement("canvas");
    if (!canvas.getContext("webgl2") && !canvas.getContext("webgl")) throw new Error("it has no WebGL.");
    // A phone is higher than wide: from farther away the whole surface is seen, the scale of colours above it.
    this.narrow = this.place.clientWidth < NARROW_PX;
    if (this.narrow) for (const axis of "xyz") this.view[axis] *= 1.6;
    await loadPlotly();
    await Plotly.newPlot(this.place, [this.surface()], this.layout(), { displayModeBar: false });
    this.drawn = true;
  }

  surface() {
    const [height, ...others] = this.map.layers;
    const axis = number => Array.from({ length: this.map.size[number] }, (_, n) => this.map.start[number] + n * this.map.step[number]);
    const lines = others.map(layer => rowsOf(this.map, layer, value => `<br>${layer.name} ${printed(value, layer.digits)} ${layer.unit}`));
    const digits = coordinateDigits(this.map);
    const title = { text: `${height.name} / ${height.unit}` };
    return {
      type: "surface",
      x: axis(0),
      y: axis(1),
      z: rowsOf(this.map, height, value => Number.isNaN(value) ? null : value),
      text: lines.length ? lines[0].map((row, j) => row.map((_, i) => lines.map(layer => layer[j][i]).join(""))) : undefined,
      colorscale: "Viridis",
      colorbar: this.narrow ? { title, thickness: 10, orientation: "h", y: 1 } : { title, thickness: 14, len: 0.7 },
      hovertemplate: `x %{x:.${digits}f} ${this.map.unit}<br>y %{y:.${digits}f} ${this.map.unit}<br>${height.name} %{z:.${height.digits}f} ${height.unit}%{text}<extra></extra>`,
    };
  }

  layout() {
    const { map, stretch } = this;
    const height = map.layers[0];
    const spans = [0, 1].map(axis => (map.size[axis] - 1) * map.step[axis]).concat(stretch * spanOf(height.values));
    const [x, y, z] = spans.map(span => 1.25 * Math.max(span, 0.02 * Math.max(...spans)) / Math.max(...spans));
    const title = (name, unit) => ({ title: { text: `${name} / ${unit}` }, showspikes: false });
    const stretched = stretch === 1 ? height.unit : `${height.unit} (${stretch} times)`;
    return {
      margin: { l: 0, r: 0, t: 0, b: 0 },
      font: { color: "#1b1f24" },
      scene: {
        aspectmode: "manual",
        aspectratio: { x, y, z },
        camera: { eye: { ...this.view } },
        xaxis: title(map.coordinates[0], map.unit),
        yaxis: title(map.coordinates[1], map.unit),
        // More would overlap on a flat box.
        zaxis: { ...title(height.name, stretched), nticks: 4 },
      },
    };
  }

  key(event) {
    if (!this.drawn) return;
    const eye = event.key === "Home" ? { ...this.view } : this.turned(event.key);
    if (!eye) return;
    event.preventDefault();
    Plotly.relayout(this.place, { "scene.camera.eye": eye });
  }

  turned(key) {
    const { x, y, z } = this.place.layout.scene.camera.eye;
    const far = Math.hypot(x, y, z);
    let around = Math.atan2(y, x), above = Math.asin(z / far), closer = 1;
    if (key === "ArrowLeft") around -= Math.PI / 18;
    else if (key === "ArrowRight") around += Math.PI / 18;
    else if (key === "ArrowUp") above = Math.min(above + Math.PI / 18, 1.55);
    else if (key === "ArrowDown") above = Math.max(above - Math.PI / 18, -1.55);
    else if (key === "+") closer = 0.9;
    else if (key === "-") closer = 1 / 0.9;
    else return null;
    const level = closer * far * Math.cos(above);
    return { x: level * Math.cos(around), y: level * Math.sin(around), z: closer * far * Math.sin(above) };
  }
}

for (const field of document.querySelectorAll(".probe")) new Probe(field);
for (const place of document.querySelectorAll(".stage")) new Stage(place);
