/* A map as coloured cells with axes in mm and a colour bar; u to the right, v up, one scale for both. */

function cellEdges(nodes) {
  const n = nodes.length, edges = new Float64Array(n + 1);
  for (let i = 1; i < n; i++) edges[i] = 0.5 * (nodes[i - 1] + nodes[i]);
  const first = n > 1 ? nodes[1] - nodes[0] : 10, last = n > 1 ? nodes[n - 1] - nodes[n - 2] : 10;
  edges[0] = nodes[0] - 0.5 * first;
  edges[n] = nodes[n - 1] + 0.5 * last;
  return edges;
}

/** Limits in mm that hold all maps and stops of a group. */
function groupExtent(maps, stops) {
  const extent = { u0: Infinity, u1: -Infinity, v0: Infinity, v1: -Infinity };
  const take = (u0, u1, v0, v1) => {
    extent.u0 = Math.min(extent.u0, u0); extent.u1 = Math.max(extent.u1, u1);
    extent.v0 = Math.min(extent.v0, v0); extent.v1 = Math.max(extent.v1, v1);
  };
  for (const map of maps) {
    const u = cellEdges(map.u), v = cellEdges(map.v);
    take(u[0], u[map.nu], v[0], v[map.nv]);
  }
  for (let k = 0; stops && k < stops.count; k++) {
    const h = 0.5 * stops.side;
    if (Number.isFinite(stops.u[k])) take(stops.u[k] - h, stops.u[k] + h, stops.v[k] - h, stops.v[k] + h);
  }
  return extent.u1 > extent.u0 ? extent : { u0: 0, u1: 1, v0: 0, v1: 1 };
}

class Heatmap {
  /** compact: a small multiple, without colour bar and axis titles. */
  constructor(canvas, extent, words, compact) {
    this.canvas = canvas;
    this.extent = extent;
    this.words = words;
    this.compact = compact;
    this.field = null;
    this.cursor = null;
    this.outline = [];
    redrawWith(canvas, () => this.draw());
  }

  /** field: {map, values} or {stops, values}; layer: an entry of LAYERS; span: [low, high]. */
  show(field, layer, span) {
    this.field = field;
    this.layer = layer;
    this.span = span;
    this.labels = layer.words ? this.words[layer.words] : null;
    this.draw();
  }

  layout() {
    const width = this.canvas.clientWidth || 300;
    const narrow = width < 480;
    const edge = this.compact
      ? { left: 34, right: 6, top: 4, bottom: 22 }
      : { left: 54, right: narrow ? 10 : this.labels ? 160 : 96, top: 10, bottom: (narrow ? 88 : 44) + (this.labels && narrow ? 24 : 0) };
    const e = this.extent, across = e.u1 - e.u0, up = e.v1 - e.v0;
    const tallest = this.compact ? 220 : Math.max(260, Math.min(560, window.innerHeight * 0.7));
    const scale = Math.min((width - edge.left - edge.right) / across, tallest / up);
    const left = edge.left + (this.compact ? 0.5 * (width - edge.left - edge.right - across * scale) : 0);
    return { width, narrow, edge, scale, left, top: edge.top, w: across * scale, h: up * scale, height: edge.top + up * scale + edge.bottom };
  }

  x(u) { return this.place.left + (u - this.extent.u0) * this.place.scale; }
  y(v) { return this.place.top + (this.extent.v1 - v) * this.place.scale; }

  /** Position in mm under a pointer event, or null outside of the frame. */
  pick(event) {
    const box = this.canvas.getBoundingClientRect();
    const u = this.extent.u0 + (event.clientX - box.left - this.place.left) / this.place.scale;
    const v = this.extent.v1 - (event.clientY - box.top - this.place.top) / this.place.scale;
    const e = this.extent;
    return u >= e.u0 && u <= e.u1 && v >= e.v0 && v <= e.v1 ? { u, v } : null;
  }

  colour(value) {
    if (this.labels) return this.words.paint[this.layer.words][value];
    return rgb(colourAt(this.words.colours[this.layer.colours], shareOf(this.layer, this.span, value)));
  }

  draw() {
    if (!this.field || !this.canvas.clientWidth) return;
    this.place = this.layout();
    const p = this.place;
    const context = sharpContext(this.canvas, p.width, p.height);
    this.ink = styleOf(this.canvas, "--ink-soft");
    this.line = styleOf(this.canvas, "--line");
    context.fillStyle = styleOf(this.canvas, "--void");
    context.fillRect(p.left, p.top, p.w, p.h);
    if (this.field.map) this.drawCells(context); else this.drawStops(context);
    this.drawOutline(context);
    this.drawAxes(context);
    if (!this.compact) this.labels ? this.drawWords(context) : this.drawBar(context);
    this.drawCursor(context);
  }

  drawCells(context) {
    const map = this.field.map, eu = cellEdges(map.u), ev = cellEdges(map.v);
    for (let j = 0; j < map.nv; j++) {
      const top = Math.round(this.y(ev[j + 1])), h = Math.round(this.y(ev[j])) - top;
      for (let i = 0; i < map.nu; i++) {
        const value = this.field.values[j * map.nu + i];
        if (Number.isNaN(value) || (this.labels && value === 0)) continue;
        const left = Math.round(this.x(eu[i]));
        context.fillStyle = this.colour(value);
        context.fillRect(left, top, Math.round(this.x(eu[i + 1])) - left, h);
      }
    }
    this.hatchPrior(context, map, eu, ev);
  }

  /** Hatch the cells that no reading holds, whatever is shown of them. */
  hatchPrior(context, map, eu, ev) {
    const regime = map.layers.regime, prior = this.words.prior, p = this.place;
    if (!regime) return;
    context.save();
    context.beginPath();
    for (let j = 0; j < map.nv; j++)
      for (let i = 0; i < map.nu; i++) {
        const k = j * map.nu + i;
        if (regime[k] !== prior || Number.isNaN(this.field.values[k])) continue;
        const left = Math.round(this.x(eu[i])), top = Math.round(this.y(ev[j + 1]));
        context.rect(left, top, Math.round(this.x(eu[i + 1])) - left, Math.round(this.y(ev[j])) - top);
      }
    context.clip();
    for (const [colour, width, shift] of [["#fff", 1.6, 0], ["#222", 1, 1.5]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      for (let x = p.left - p.h; x < p.left + p.w; x += 5) {
        context.moveTo(x + shift, p.top + p.h);
        context.lineTo(x + p.h + shift, p.top);
      }
      context.stroke();
    }
    context.restore();
  }

  drawStops(context) {
    const stops = this.field.stops, side = stops.side * this.place.scale * 0.92;
    context.strokeStyle = this.ink;
    for (let k = 0; k < stops.count; k++) {
      const value = this.field.values[k];
      const left = this.x(stops.u[k]) - side / 2, top = this.y(stops.v[k]) - side / 2;
      if (Number.isNaN(value)) {
        context.strokeRect(left + 1, top + 1, Math.max(1, side - 2), Math.max(1, side - 2));
      } else {
        context.fillStyle = this.colour(value);
        context.fillRect(left, top, side, side);
      }
    }
  }

  drawOutline(context) {
    if (this.outline.length < 3) return;
    context.beginPath();
    for (const [u, v] of this.outline) context.lineTo(this.x(u), this.y(v));
    context.closePath();
    context.lineWidth = 3;
    context.strokeStyle = "rgba(255,255,255,.75)";
    context.stroke();
    context.lineWidth = 1.2;
    context.strokeStyle = "#111";
    context.stroke();
  }

  drawAxes(context) {
    const p = this.place, e = this.extent, bottom = p.top + p.h;
    context.lineWidth = 1;
    context.strokeStyle = this.line;
    context.strokeRect(p.left + 0.5, p.top + 0.5, p.w - 1, p.h - 1);
    context.fillStyle = this.ink;
    context.font = this.compact ? "10px system-ui, sans-serif" : "12px system-ui, sans-serif";
    const us = roundTicks(e.u0, e.u1, p.w / (this.compact ? 55 : 70)), vs = roundTicks(e.v0, e.v1, p.h / (this.compact ? 45 : 60));
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const u of us) {
      context.fillRect(Math.round(this.x(u)), bottom, 1, 4);
      context.fillText(tickText(u, us), this.x(u), bottom + 7);
    }
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const v of vs) {
      context.fillRect(p.left - 4, Math.round(this.y(v)), 4, 1);
      context.fillText(tickText(v, vs), p.left - 7, this.y(v));
    }
    if (this.compact) return;
    context.textAlign = "center";
    context.textBaseline = "top";
    context.fillText("u (mm)", p.left + p.w / 2, bottom + 25);
    context.save();
    context.translate(14, p.top + p.h / 2);
    context.rotate(-Math.PI / 2);
    context.fillText("v (mm)", 0, -6);
    context.restore();
  }

  /** Colour bar with ticks: at the right, or below the map on a narrow screen. */
  drawBar(context) {
    const p = this.place, flat = p.narrow, length = flat ? p.w : p.h, steps = Math.ceil(length);
    const at = flat ? { x: p.left, y: p.top + p.h + 46 } : { x: p.left + p.w + 18, y: p.top };
    const anchors = this.words.colours[this.layer.colours];
    for (let k = 0; k < steps; k++) {
      context.fillStyle = rgb(colourAt(anchors, k / (steps - 1)));
      if (flat) context.fillRect(at.x + k, at.y, 1.5, 12); else context.fillRect(at.x, at.y + length - k - 1, 14, 1.5);
    }
    context.fillStyle = this.ink;
    const ticks = ticksOf(this.layer, this.span, length / (flat ? 48 : 55));
    const share = (value) => shareOf(this.layer, this.span, value);
    for (const tick of ticks) {
      context.textAlign = flat ? "center" : "left";
      context.textBaseline = flat ? "top" : "middle";
      if (flat) context.fillText(tickWords(this.layer, tick, ticks), at.x + share(tick) * length, at.y + 16);
      else context.fillText(tickWords(this.layer, tick, ticks), at.x + 20, at.y + length * (1 - share(tick)));
    }
    if (!this.layer.unit) return;
    context.textBaseline = "top";
    if (flat) { context.textAlign = "right"; context.fillText(this.layer.unit, at.x + length, at.y - 16); }
    else { context.textAlign = "left"; context.fillText(this.layer.unit, at.x, at.y + length + 8); }
  }

  drawWords(context) {
    const p = this.place, used = new Set();
    for (const value of this.field.values) if (!Number.isNaN(value)) used.add(value);
    let x = p.narrow ? p.left : p.left + p.w + 14, y = p.narrow ? p.top + p.h + 46 : p.top + 8;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.font = "11px system-ui, sans-serif";
    for (const value of [...used].sort((a, b) => a - b)) {
      if (this.field.map && value === 0) continue;
      const text = this.labels[value], wide = context.measureText(text).width + 24;
      if (p.narrow && x + wide > p.width) { x = p.left; y += 18; }
      context.fillStyle = this.colour(value);
      context.fillRect(x, y - 5, 10, 10);
      context.fillStyle = this.ink;
      context.fillText(text, x + 14, y);
      if (p.narrow) x += wide; else y += 20;
    }
  }

  drawCursor(context) {
    if (!this.cursor) return;
    const p = this.place, x = this.x(this.cursor.u), y = this.y(this.cursor.v);
    for (const [colour, width] of [["rgba(255,255,255,.85)", 2.5], ["#111", 1]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.moveTo(x, p.top); context.lineTo(x, p.top + p.h);
      context.moveTo(p.left, y); context.lineTo(p.left + p.w, y);
      context.stroke();
    }
  }
}
