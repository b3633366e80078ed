/* The surface in perspective-free view on a plain canvas: far cells first, so that no graphics driver is needed. */

class Relief {
  constructor(canvas, group) {
    this.canvas = canvas;
    this.group = group;
    this.yaw = -0.55;
    this.pitch = 0.42;
    this.zoom = 1;
    this.stretch = 1;
    this.wire = null;
    this.field = null;
    this.linked = [this];
    this.bare = false;
    redrawWith(canvas, () => this.draw());
  }

  /** map: the surface; values, layer, span: what colours it; wire: a map drawn as lines over it, or null. */
  show(map, values, layer, span, wire) {
    this.field = { map, values, layer, span };
    this.wire = wire;
    this.draw();
  }

  listen() {
    const canvas = this.canvas, fingers = new Map();
    let gap = 0;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, event);
    });
    const lift = (event) => { fingers.delete(event.pointerId); gap = 0; };
    canvas.addEventListener("pointerup", lift);
    canvas.addEventListener("pointercancel", lift);
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      fingers.set(event.pointerId, event);
      if (fingers.size === 2) {
        const [a, b] = [...fingers.values()], now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
        if (gap) this.scale(now / gap);
        gap = now;
      } else this.turn((event.clientX - before.clientX) * 0.008, (event.clientY - before.clientY) * 0.008);
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      this.scale(Math.exp(-event.deltaY * 0.0015));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (turns[event.key]) this.turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "=") this.scale(1.15);
      else if (event.key === "-") this.scale(1 / 1.15);
      else return;
      event.preventDefault();
    });
  }

  turn(yaw, pitch) {
    this.view(this.yaw + yaw, Math.max(-1.5, Math.min(1.5, this.pitch + pitch)), this.zoom);
  }

  scale(factor) { this.view(this.yaw, this.pitch, Math.max(0.5, Math.min(6, this.zoom * factor))); }

  /** Reliefs that are linked turn together. */
  view(yaw, pitch, zoom) {
    for (const relief of this.linked) {
      Object.assign(relief, { yaw, pitch, zoom });
      relief.later();
    }
  }

  later() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  /** Screen position and depth of (u, v, w) in mm: turn about v, then tilt about u. */
  project(u, v, w) {
    const c = this.centre, x = u - c[0], y = v - c[1], z = (w - c[2]) * this.stretch;
    const across = this.cy * x + this.sy * z, back = -this.sy * x + this.cy * z;
    return [this.midX + this.unit * across, this.midY - this.unit * (this.cp * y - this.sp * back)];
  }

  aim(width, height) {
    const [low, high] = this.group.spans.height, e = this.group.extent;
    this.low = low;
    this.high = high;
    this.centre = [0.5 * (e.u0 + e.u1), 0.5 * (e.v0 + e.v1), 0.5 * (low + high)];
    [this.cy, this.sy] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    [this.cp, this.sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    // Fit the turned box of all values into the canvas, leaving room for labels and the colour bar.
    [this.unit, this.midX, this.midY] = [1, 0, 0];
    const box = this.corners().map((corner) => this.project(...corner));
    const xs = box.map((spot) => spot[0]), ys = box.map((spot) => spot[1]);
    const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const room = this.bare ? [30, 20, 20] : [width < 420 ? 62 : 74, 24, 62];
    this.unit = this.zoom * Math.min((width - 2 * room[0]) / (x1 - x0), (height - room[1] - room[2]) / (y1 - y0));
    this.midX = width / 2 - (this.unit * (x0 + x1)) / 2;
    this.midY = room[1] + (height - room[1] - room[2]) / 2 - (this.unit * (y0 + y1)) / 2;
  }

  corners() {
    const e = this.group.extent, all = [];
    for (const u of [e.u0, e.u1]) for (const v of [e.v0, e.v1]) for (const w of [this.low, this.high]) all.push([u, v, w]);
    return all;
  }

  draw() {
    if (!this.field || !this.canvas.clientWidth) return;
    const width = this.canvas.clientWidth, height = Math.max(300, Math.min(460, width * 0.8));
    const context = sharpContext(this.canvas, width, height);
    this.aim(width, height);
    this.drawBase(context);
    this.drawCells(context);
    if (this.wire) this.drawWire(context);
    if (this.bare) return;
    this.drawLabels(context);
    this.drawBar(context, width, height);
  }

  /** The base rectangle at the lowest height. */
  drawBase(context) {
    const e = this.group.extent, corners = [[e.u0, e.v0], [e.u1, e.v0], [e.u1, e.v1], [e.u0, e.v1]];
    const base = corners.map(([u, v]) => this.project(u, v, this.low));
    context.strokeStyle = styleOf(this.canvas, "--line");
    context.fillStyle = styleOf(this.canvas, "--card");
    context.lineWidth = 1;
    context.beginPath();
    for (const [x, y] of base) context.lineTo(x, y);
    context.closePath();
    context.fill();
    context.stroke();
  }

  /** Of the four edges of the box along each axis the outermost one, with its length. */
  drawLabels(context) {
    const e = this.group.extent, middle = this.project(...this.centre);
    const ends = { u: [e.u0, e.u1], v: [e.v0, e.v1], w: [this.low, this.high] }, names = ["u", "v", "w"];
    context.font = "12px system-ui, sans-serif";
    for (let axis = 0; axis < 3; axis++) {
      const [p, q] = names.filter((_, k) => k !== axis);
      let best = null;
      for (const a of ends[p]) for (const b of ends[q]) {
        const edge = ends[names[axis]].map((along) => this.project(...names.map((name) => (name === names[axis] ? along : name === p ? a : b))));
        const spot = [0.5 * (edge[0][0] + edge[1][0]), 0.5 * (edge[0][1] + edge[1][1])];
        const far = Math.hypot(spot[0] - middle[0], spot[1] - middle[1]) + 0.02 * (spot[1] - spot[0]);
        if (!best || far > best.far) best = { far, edge, spot };
      }
      this.drawEdge(context, best, middle, `${names[axis]} ${(ends[names[axis]][1] - ends[names[axis]][0]).toFixed(axis === 2 ? 1 : 0)} mm`);
    }
  }

  drawEdge(context, { edge, spot }, middle, text) {
    if (Math.hypot(edge[1][0] - edge[0][0], edge[1][1] - edge[0][1]) < 12) return;
    context.strokeStyle = styleOf(this.canvas, "--ink-soft");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(...edge[0]);
    context.lineTo(...edge[1]);
    context.stroke();
    const away = Math.hypot(spot[0] - middle[0], spot[1] - middle[1]) || 1, wide = context.measureText(text).width / 2;
    const x = spot[0] + ((wide + 8) * (spot[0] - middle[0])) / away, y = spot[1] + (15 * (spot[1] - middle[1])) / away;
    context.fillStyle = styleOf(this.canvas, "--ink");
    context.textAlign = "center";
    context.textBaseline = "middle";
    this.halo(context, text, Math.max(wide + 2, Math.min(this.canvas.clientWidth - wide - 2, x)), y);
  }

  halo(context, text, x, y) {
    context.lineWidth = 4;
    context.lineJoin = "round";
    context.strokeStyle = styleOf(this.canvas, "--void");
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  }

  drawBar(context, width, height) {
    const { layer, span } = this.field;
    if (layer.words) return;
    const anchors = this.group.words.colours[layer.colours], long = Math.min(260, width - 60), left = 0.5 * (width - long), top = height - 30;
    for (let k = 0; k < long; k++) {
      context.fillStyle = rgb(colourAt(anchors, k / (long - 1)));
      context.fillRect(left + k, top, 1.5, 9);
    }
    context.fillStyle = styleOf(this.canvas, "--ink-soft");
    context.textBaseline = "top";
    const ticks = ticksOf(layer, span, long / 60);
    context.textAlign = "center";
    for (const tick of ticks) context.fillText(tickWords(layer, tick, ticks), left + long * shareOf(layer, span, tick), top + 12);
    context.textAlign = "left";
    context.textBaseline = "middle";
    if (layer.unit) context.fillText(layer.unit, left + long + 8, top + 5);
  }

  colourOf(value, light) {
    const { layer, span } = this.field, words = this.group.words;
    let colour = [150, 150, 150];
    if (layer.words && !Number.isNaN(value)) {
      const code = parseInt(words.paint[layer.words][value].slice(1), 16);
      colour = [code >> 16, (code >> 8) & 255, code & 255];
    } else if (!Number.isNaN(value)) colour = colourAt(words.colours[layer.colours], shareOf(layer, span, value));
    return rgb(colour.map((c) => Math.round(Math.min(255, c * light))));
  }

  drawCells(context) {
    const { map, values } = this.field, height = map.layers.height;
    const spots = new Array(map.nu * map.nv);
    for (let j = 0; j < map.nv; j++)
      for (let i = 0; i < map.nu; i++) {
        const w = height[j * map.nu + i];
        spots[j * map.nu + i] = Number.isNaN(w) ? null : this.project(map.u[i], map.v[j], w);
      }
    // Depth grows with -sin(yaw) cos(pitch) u and sin(pitch) v: walk from far to near along both.
    const order = (n, towards) => Array.from({ length: n - 1 }, (_, k) => (towards ? k : n - 2 - k));
    const columns = order(map.nu, -this.sy * this.cp > 0), rows = order(map.nv, this.sp > 0);
    const along = Math.abs(this.sy * this.cp) > Math.abs(this.sp);
    context.lineWidth = 1;
    context.lineJoin = "round";
    for (const a of along ? columns : rows)
      for (const b of along ? rows : columns) this.drawCell(context, map, values, spots, along ? a : b, along ? b : a);
  }

  drawCell(context, map, values, spots, i, j) {
    const k = [j * map.nu + i, j * map.nu + i + 1, (j + 1) * map.nu + i + 1, (j + 1) * map.nu + i];
    if (k.some((n) => spots[n] === null)) return;
    const h = k.map((n) => map.layers.height[n]), du = map.u[i + 1] - map.u[i], dv = map.v[j + 1] - map.v[j];
    const slopeU = ((h[1] + h[2] - h[0] - h[3]) / (2 * du)) * this.stretch, slopeV = ((h[2] + h[3] - h[0] - h[1]) / (2 * dv)) * this.stretch;
    const light = 0.62 + (0.45 * (1 + 0.35 * slopeU - 0.45 * slopeV)) / Math.hypot(1, slopeU, slopeV);
    const regime = map.layers.regime, guessed = regime && k.some((n) => regime[n] === this.group.words.prior);
    const value = this.field.layer.words ? values[k[0]] : 0.25 * (values[k[0]] + values[k[1]] + values[k[2]] + values[k[3]]);
    // Grey: no reading holds a corner of it.
    context.fillStyle = this.colourOf(guessed && !this.field.layer.words ? NaN : value, Math.max(0.45, Math.min(1.15, light)));
    context.strokeStyle = context.fillStyle;
    context.beginPath();
    for (const n of k) context.lineTo(spots[n][0], spots[n][1]);
    context.closePath();
    context.fill();
    context.stroke();
  }

  drawWire(context) {
    const map = this.wire, height = map.layers.height;
    context.strokeStyle = styleOf(this.canvas, "--ink");
    context.globalAlpha = 0.55;
    context.lineWidth = 1;
    const skipU = Math.max(1, Math.round(map.nu / 20)), skipV = Math.max(1, Math.round(map.nv / 20));
    const stroke = (count, index) => {
      let pen = false;
      context.beginPath();
      for (let n = 0; n < count; n++) {
        const [i, j] = index(n), w = height[j * map.nu + i];
        if (Number.isNaN(w)) { pen = false; continue; }
        const spot = this.project(map.u[i], map.v[j], w);
        if (pen) context.lineTo(...spot); else context.moveTo(...spot);
        pen = true;
      }
      context.stroke();
    };
    for (let j = 0; j < map.nv; j += skipV) stroke(map.nu, (n) => [n, j]);
    for (let i = 0; i < map.nu; i += skipU) stroke(map.nv, (n) => [i, n]);
    context.globalAlpha = 1;
  }
}
