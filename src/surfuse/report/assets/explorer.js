/* The maps of one run: choose map, layer and sensor; the cursor drives read-out and cuts. */

function readGroup(raw, words) {
  const group = { maps: raw.maps.map(readMap), spans: raw.spans, stops: readStops(raw.stops), outline: raw.outline || [], words };
  // A nearly flat part is read to the micrometre.
  group.digits = raw.spans.height[1] - raw.spans.height[0] < 5 ? 3 : 2;
  group.extent = groupExtent(group.maps, group.stops);
  return group;
}

function part(host, role) { return host.querySelector(`[data-role="${role}"]`); }

function fillSelect(select, options) {
  select.replaceChildren(...options.map(([value, text]) => node("option", { value }, text)));
}

/** One number a stop: of one sensor, or the mean over the sensors that took part (for gates: how many did not). */
function stopValues(stops, name, sensor) {
  const own = { depth: stops.depth }[name];
  if (own) return own;
  return Float32Array.from({ length: stops.count }, (_, k) => {
    let sum = 0, n = 0, kept = 0;
    for (let r = stops.start[k]; r < stops.start[k + 1]; r++) {
      if (sensor >= 0 && stops.sensor[r] !== sensor) continue;
      if (name === "gate" && sensor >= 0) return stops.gate[r];
      if (stops.gate[r]) { kept++; continue; }
      if (!Number.isNaN(stops[name][r])) { sum += stops[name][r]; n++; }
    }
    if (name === "gate") return sensor >= 0 ? NaN : kept;
    return n ? sum / n : NaN;
  });
}

function finiteSpan(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
  if (!(high >= low)) return [0, 1];
  return high - low < 0.2 ? [low - 0.1, high + 0.1] : [low, high];
}

class Explorer {
  constructor(host, group) {
    this.host = host;
    this.group = group;
    const e = group.extent;
    this.cursor = { u: 0.5 * (e.u0 + e.u1), v: 0.5 * (e.v0 + e.v1) };
    this.pinned = false;
    this.heat = new Heatmap(part(host, "heat"), e, group.words, false);
    this.heat.outline = group.outline;
    this.cuts = ["u", "v"].map((along) => new CutChart(part(host, `cut-${along}`), along, e, group.words.prior));
    this.fillControls();
    this.listen();
    this.update();
  }

  fillControls() {
    const { maps, stops } = this.group;
    fillSelect(part(this.host, "map"), maps.map((map, k) => [k, map.label]));
    const sensors = stops ? stops.sensors.map((name, k) => [k, name]) : [];
    fillSelect(part(this.host, "sensor"), [[-1, "mean of all that took part"], ...sensors]);
    this.fillLayers();
    for (const axis of ["u", "v"]) {
      const slider = part(this.host, `slide-${axis}`);
      slider.min = this.group.extent[`${axis}0`];
      slider.max = this.group.extent[`${axis}1`];
      slider.step = "any";
    }
  }

  fillLayers() {
    const select = part(this.host, "layer"), before = select.value, map = this.group.maps[this.chosen()];
    const own = Object.keys(LAYERS).filter((name) => map.layers[name]).map((name) => [name, this.title(LAYERS[name])]);
    const groups = [node("optgroup", { label: "map" }, ...own.map(([value, text]) => node("option", { value }, text)))];
    if (this.group.stops) {
      const stop = Object.keys(STOP_LAYERS).map((name) => node("option", { value: `stop-${name}` }, this.title(STOP_LAYERS[name])));
      groups.push(node("optgroup", { label: "stops" }, ...stop));
    }
    select.replaceChildren(...groups);
    if ([...select.options].some((option) => option.value === before)) select.value = before;
  }

  title(layer) { return layer.unit ? `${layer.title} (${layer.unit})` : layer.title; }
  chosen() { return Number(part(this.host, "map").value) || 0; }

  listen() {
    const canvas = this.heat.canvas;
    part(this.host, "map").addEventListener("change", () => { this.fillLayers(); this.update(); });
    for (const role of ["layer", "sensor"]) part(this.host, role).addEventListener("change", () => this.update());
    for (const axis of ["u", "v"]) part(this.host, `slide-${axis}`).addEventListener("input", (event) => this.move({ [axis]: Number(event.target.value) }));
    canvas.addEventListener("pointermove", (event) => { if (!this.pinned && event.pointerType !== "touch") this.follow(event); });
    canvas.addEventListener("click", (event) => {
      this.pinned = !this.pinned || event.detail === 0;
      this.follow(event);
    });
    canvas.addEventListener("keydown", (event) => this.step(event));
  }

  follow(event) {
    const place = this.heat.pick(event);
    if (place) this.move(place);
  }

  step(event) {
    const map = this.group.maps[this.chosen()], du = Math.abs(map.u[1] - map.u[0]) || 1, dv = Math.abs(map.v[1] - map.v[0]) || 1;
    const moves = { ArrowLeft: { u: this.cursor.u - du }, ArrowRight: { u: this.cursor.u + du }, ArrowUp: { v: this.cursor.v + dv }, ArrowDown: { v: this.cursor.v - dv } };
    if (event.key === "Escape") this.pinned = false;
    if (!moves[event.key]) return;
    event.preventDefault();
    this.pinned = true;
    this.move(moves[event.key]);
  }

  move(place) {
    const e = this.group.extent, next = { ...this.cursor, ...place };
    this.cursor = { u: Math.max(e.u0, Math.min(e.u1, next.u)), v: Math.max(e.v0, Math.min(e.v1, next.v)) };
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.update(); });
  }

  update() {
    this.showField();
    this.caption();
    fillReadout(part(this.host, "readout"), this.group, this.chosen(), this.cursor);
    for (const chart of this.cuts) {
      const other = chart.along === "u" ? "v" : "u";
      const series = seriesOf(this.group, this.chosen(), chart.along, this.cursor[other], chart.host);
      chart.show(series, this.cursor[other], this.cursor[chart.along], this.group.spans.height);
      drawLegend(part(this.host, "legend"), series);
      part(this.host, `slide-${other}`).value = this.cursor[other];
      part(this.host, `at-${other}`).textContent = number(this.cursor[other], 1, "mm");
    }
  }

  showField() {
    const name = part(this.host, "layer").value, map = this.group.maps[this.chosen()], sensor = Number(part(this.host, "sensor").value);
    this.heat.cursor = this.cursor;
    const ofStops = name.startsWith("stop-");
    part(this.host, "sensor").closest("label").hidden = !ofStops || name === "stop-depth";
    if (!ofStops) return this.heat.show({ map, values: map.layers[name] }, LAYERS[name], this.group.spans[name] || [0, 1]);
    const stops = this.group.stops, short = name.slice(5), values = stopValues(stops, short, sensor);
    const reasons = short === "gate" && sensor >= 0;
    const layer = reasons ? { title: "Gate", unit: "", words: "gates", digits: 0 } : STOP_LAYERS[short];
    const span = short === "depth" ? finiteSpan(values) : short === "gate" ? [0, Math.max(1, stops.sensors.length)] : [0, 1];
    return this.heat.show({ stops, values }, layer, span);
  }

  caption() {
    const text = (select) => select.options[select.selectedIndex].textContent, layer = part(this.host, "layer"), sensor = part(this.host, "sensor");
    const where = layer.value.startsWith("stop-") ? (sensor.closest("label").hidden ? "" : `, ${text(sensor)}`) : `, ${text(part(this.host, "map"))}`;
    part(this.host, "caption").textContent = `${text(layer)}${where}. ${this.group.outline.length ? "The thin line is the outline. " : ""}Empty: no value.`;
  }
}

/** One of the linked views: which surface, and what colours it. */
function startView(host, group, stretchOf, wireOn) {
  const relief = new Relief(part(host, "relief"), group), truth = group.maps.find((map) => map.truth);
  const select = part(host, "relief-map"), colour = part(host, "relief-colour");
  fillSelect(select, group.maps.map((map, k) => [k, map.label]));
  const show = () => {
    const map = group.maps[Number(select.value)], before = colour.value;
    const names = ["height", "error", "sigma", "confidence", "regime", "weight"].filter((name) => map.layers[name]);
    fillSelect(colour, names.map((name) => [name, LAYERS[name].title]));
    if (names.includes(before)) colour.value = before;
    relief.stretch = stretchOf();
    const name = colour.value;
    part(host, "relief-caption").textContent = `${map.label}, coloured by: ${LAYERS[name].title.toLowerCase()}`;
    relief.show(map, map.layers[name], LAYERS[name], group.spans[name] || [0, 1], wireOn() && truth && !map.truth ? truth : null);
  };
  for (const control of [select, colour]) control.addEventListener("input", show);
  relief.listen();
  return { relief, select, colour, show };
}

function startRelief(host, group) {
  const stretch = part(host, "stretch"), wire = part(host, "wire");
  const stretchOf = () => Math.pow(10, Number(stretch.value));
  const views = [...host.querySelectorAll("[data-role='view']")].map((one) => startView(one, group, stretchOf, () => wire.checked));
  const truth = group.maps.findIndex((map) => map.truth), [first, second] = views;
  for (const view of views) view.relief.linked = views.map((one) => one.relief);
  if (truth < 0) wire.closest("label").remove();
  const update = () => {
    const factor = stretchOf();
    part(host, "stretch-value").textContent = `× ${factor < 9.95 ? factor.toFixed(1) : factor.toFixed(0)}`;
    for (const view of views) view.show();
  };
  // Beside the map: the truth, or the next map, or else its own uncertainty.
  first.show();
  second.select.value = truth >= 0 ? truth : Math.min(1, group.maps.length - 1);
  second.show();
  if (group.maps.length === 1) second.colour.value = "sigma";
  for (const control of [stretch, wire]) control.addEventListener("input", update);
  update();
}
