/* A profile cut: height against u or v of several maps, the chosen one with its band of two standard deviations. */

/** A layer of one map along a cut: {x, y, sigma} in mm; `guessed` where only the prior speaks; `second` and its `weight`. */
function cutThrough(map, along, at, layer = "height") {
  const across = along === "u" ? map.v : map.u;
  const k = nearestIndex(across, at);
  const n = along === "u" ? map.nu : map.nv;
  const index = (i) => (along === "u" ? k * map.nu + i : i * map.nu + k);
  const { sigma, regime, second, weight } = map.layers, values = map.layers[layer];
  const along_cut = (from) => (from ? Float32Array.from({ length: n }, (_, i) => from[index(i)]) : null);
  return {
    x: along === "u" ? map.u : map.v,
    y: values ? along_cut(values) : new Float32Array(n).fill(layer === "error" && map.truth ? 0 : NaN),
    sigma: along_cut(sigma),
    regime: along_cut(regime),
    second: layer === "height" ? along_cut(second) : null,
    weight: along_cut(weight),
  };
}

class CutChart {
  /** prior: the number of the kind of evidence that no reading stands for. */
  constructor(host, along, extent, prior) {
    this.host = host;
    this.along = along;
    this.extent = extent;
    this.series = [];
    this.prior = prior;
    this.title = "";
    redrawWith(host, () => this.draw());
  }

  /** series: [{label, kind, colour, x, y, sigma}]; at: the other coordinate; mark: where the cursor stands. */
  show(series, at, mark, span) {
    Object.assign(this, { series, at, mark, span });
    this.draw();
  }

  limits() {
    let [low, high] = this.span;
    for (const one of this.series) for (const y of one.y) if (Number.isFinite(y)) { low = Math.min(low, y); high = Math.max(high, y); }
    const pad = 0.08 * Math.max(high - low, 1);
    return [low - pad, high + pad];
  }

  draw() {
    const width = this.host.clientWidth;
    if (!width || !this.series.length) return;
    const height = Math.max(220, Math.min(300, width * 0.55));
    const e = this.extent, [x0, x1] = this.along === "u" ? [e.u0, e.u1] : [e.v0, e.v1];
    const [y0, y1] = this.limits();
    const left = 56, top = 12, w = width - left - 12, h = height - top - 44;
    const X = (x) => left + (w * (x - x0)) / (x1 - x0), Y = (y) => top + (h * (y1 - y)) / (y1 - y0);
    const other = this.along === "u" ? "v" : "u";
    const svg = svgNode("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", class: "chart" });
    svg.setAttribute("aria-label", `Profile along ${this.along} at ${other} = ${this.at.toFixed(1)} mm`);
    this.axes(svg, { x0, x1, y0, y1, left, top, w, h, X, Y });
    for (const one of this.series) if (one.sigma && (one.kind === "chosen" || one.banded)) svg.append(this.band(one, X, Y, y0, y1));
    // The chosen map last: it must not hide under another.
    for (const kind of ["other", "truth", "chosen"]) for (const one of this.series) if (one.kind === kind) svg.append(...this.curves(one, X, Y));
    for (const one of this.series) if (one.second && (one.kind === "chosen" || one.banded)) svg.append(...this.spots(one, X, Y));
    if (this.mark !== null) svg.append(svgNode("line", { x1: X(this.mark), x2: X(this.mark), y1: top, y2: top + h, class: "cursor-line" }));
    this.host.replaceChildren(svg);
  }

  axes(svg, p) {
    const xs = roundTicks(p.x0, p.x1, p.w / 70), ys = roundTicks(p.y0, p.y1, p.h / 45);
    for (const x of xs) {
      svg.append(svgNode("line", { x1: p.X(x), x2: p.X(x), y1: p.top, y2: p.top + p.h, class: "grid" }));
      svg.append(svgNode("text", { x: p.X(x), y: p.top + p.h + 16, "text-anchor": "middle", class: "tick-label" }, tickText(x, xs)));
    }
    for (const y of ys) {
      svg.append(svgNode("line", { x1: p.left, x2: p.left + p.w, y1: p.Y(y), y2: p.Y(y), class: "grid" }));
      svg.append(svgNode("text", { x: p.left - 6, y: p.Y(y) + 4, "text-anchor": "end", class: "tick-label" }, tickText(y, ys)));
    }
    svg.append(svgNode("rect", { x: p.left, y: p.top, width: p.w, height: p.h, class: "frame" }));
    svg.append(svgNode("text", { x: p.left + p.w / 2, y: p.top + p.h + 36, "text-anchor": "middle", class: "axis-title" }, `${this.along} (mm)`));
    const turn = `translate(14 ${p.top + p.h / 2}) rotate(-90)`;
    svg.append(svgNode("text", { transform: turn, "text-anchor": "middle", class: "axis-title" }, this.title || "w (mm)"));
  }

  /** The line of a map: whole where readings hold it, dotted where only the prior does. */
  curves(one, X, Y) {
    const spot = (i) => `${X(one.x[i]).toFixed(1)} ${Y(one.y[i]).toFixed(1)}`, known = (i) => i >= 0 && Number.isFinite(one.y[i]);
    const guessed = (i) => Boolean(one.regime) && one.regime[i] === this.prior;
    const paths = { held: "", guessed: "" };
    let before = "";
    for (let i = 0; i < one.x.length; i++) {
      if (!known(i)) { before = ""; continue; }
      const kind = guessed(i) || (known(i - 1) && guessed(i - 1)) ? "guessed" : "held";
      if (known(i - 1)) paths[kind] += `${before === kind ? "" : `M${spot(i - 1)}`}L${spot(i)}`;
      before = known(i - 1) ? kind : "";
    }
    return Object.keys(paths).filter((kind) => paths[kind]).map((kind) =>
      svgNode("path", { d: paths[kind], class: `curve ${one.kind}${one.dashed ? " dashed" : ""} ${kind}`, style: `stroke:${one.colour}` }));
  }

  /** The second surface: a ring where one competes, the fuller the more probable it is. */
  spots(one, X, Y) {
    const made = [];
    for (let i = 0; i < one.x.length; i++) {
      if (!Number.isFinite(one.second[i]) || !(one.weight[i] >= 0.01)) continue;
      const style = `stroke:${one.colour};fill:${one.colour};fill-opacity:${Math.min(1, 2 * one.weight[i]).toFixed(2)}`;
      made.push(svgNode("circle", { cx: X(one.x[i]).toFixed(1), cy: Y(one.second[i]).toFixed(1), r: 3, class: "second", style }));
    }
    return made;
  }

  band(one, X, Y, y0, y1) {
    const clip = (y) => Math.max(y0, Math.min(y1, y));
    let d = "", run = [];
    const close = () => {
      const lower = run.slice().reverse();
      const upper = run.map((i) => `${X(one.x[i]).toFixed(1)} ${Y(clip(one.y[i] + 2 * one.sigma[i])).toFixed(1)}`);
      const under = lower.map((i) => `${X(one.x[i]).toFixed(1)} ${Y(clip(one.y[i] - 2 * one.sigma[i])).toFixed(1)}`);
      if (run.length > 1) d += `M${upper.join("L")}L${under.join("L")}Z`;
      run = [];
    };
    for (let i = 0; i < one.x.length; i++) {
      if (Number.isFinite(one.y[i]) && Number.isFinite(one.sigma[i])) run.push(i); else close();
    }
    close();
    return svgNode("path", { d, class: "band", style: `fill:${one.colour}` });
  }
}

/** Line colours of a group: the chosen map in the accent colour, truth in ink, the others by rank. */
function seriesOf(group, chosen, along, at, host) {
  // Without the green that is close to the accent colour.
  const others = group.words.categories.filter((_, k) => k !== 2);
  let rank = 0;
  return group.maps.map((map, k) => {
    const kind = map.truth ? "truth" : k === chosen ? "chosen" : "other";
    const own = map.truth ? styleOf(host, "--ink") : group.colourOf ? group.colourOf[k] : null;
    const colour = own || (kind === "chosen" ? styleOf(host, "--accent") : others[rank++ % others.length]);
    const dashed = (group.colourOf ? k : rank) >= others.length && kind === "other";
    return { label: map.label, kind, colour, dashed, ...cutThrough(map, along, at) };
  });
}

function drawLegend(host, series) {
  host.replaceChildren(...series.map((one) => node("span", { class: `key ${one.kind}${one.dashed ? " dashed" : ""}`, style: `--key:${one.colour}` }, one.label)));
}
