/* Two methods on the readings of one run: layer by layer in the same colours, and cuts through both with their bands. */

const ROWS = ["height", "error", "sigma", "regime", "weight"];

class SideBySide {
  constructor(host, group) {
    this.host = host;
    this.group = group;
    this.pair = JSON.parse(host.dataset.pair).map((k) => group.maps[k]);
    this.truth = group.maps.find((map) => map.truth) || null;
    this.cursor = this.startOfCuts();
    this.rows = ROWS.map((name) => this.makeRow(name)).filter((row) => row);
    this.cuts = ["u", "v"].map((along) => new CutChart(part(host, `side-cut-${along}`), along, group.extent, group.words.prior));
    this.fillControls();
    this.update();
  }

  /** The cuts start where the two methods differ most, away from the rim, or in the middle of a single one. */
  startOfCuts() {
    const [a, b] = this.pair, e = this.group.extent;
    const best = { u: 0.5 * (e.u0 + e.u1), v: 0.5 * (e.v0 + e.v1) };
    if (!b || a.nu !== b.nu || a.nv !== b.nv) return best;
    for (const along of ["u", "v"]) {
      let most = 0;
      const n = along === "u" ? a.nu : a.nv, m = along === "u" ? a.nv : a.nu;
      for (let i = Math.round(0.15 * n); i < 0.85 * n; i++) {
        let sum = 0;
        for (let j = 0; j < m; j++) {
          const k = along === "u" ? j * a.nu + i : i * a.nu + j, d = Math.abs(a.layers.height[k] - b.layers.height[k]);
          if (Number.isFinite(d)) sum += d;
        }
        if (sum > most) { most = sum; best[along] = (along === "u" ? a.u : a.v)[i]; }
      }
    }
    return best;
  }

  makeRow(name) {
    const maps = this.pair.concat(name === "height" && this.truth ? [this.truth] : []).filter((map) => map.layers[name]);
    if (!maps.length || (name === "weight" && !maps.some((map) => map.layers.weight.some((share) => share > 0)))) return null;
    const layer = LAYERS[name], scale = node("div", { class: "scale" }), shown = node("div", { class: "sides" });
    const title = node("h3", {}, layer.unit ? `${layer.title} (${layer.unit})` : layer.title);
    const figures = maps.map((map) => this.makeFigure(map, name, shown));
    if (name === "weight") figures.push(...maps.filter((map) => map.layers.second).map((map) => this.makeFigure(map, "second", shown)));
    part(this.host, "rows").append(node("div", { class: figures.length > 2 ? "side-row wide" : "side-row" }, title, scale, shown));
    return { name, layer, figures, scale };
  }

  makeFigure(map, name, shown) {
    const canvas = node("canvas", { role: "img", "aria-label": `${LAYERS[name].title}, ${map.label}` });
    const value = node("span", { class: "value" }), text = name === "second" ? `${map.label}: height of the second surface` : map.label;
    shown.append(node("figure", {}, canvas, node("figcaption", {}, node("strong", {}, soft(text)), value)));
    const heat = new Heatmap(canvas, this.group.extent, this.group.words, true);
    canvas.addEventListener("pointermove", (event) => { if (event.pointerType !== "touch") this.follow(heat, event); });
    canvas.addEventListener("click", (event) => this.follow(heat, event));
    return { map, name, heat, value };
  }

  fillControls() {
    const cut = part(this.host, "cut-of"), own = part(this.host, "own-scale");
    fillSelect(cut, [["height", "height w"], ...(this.truth ? [["error", "error: map − truth"]] : [])]);
    for (const control of [cut, own]) control.addEventListener("change", () => this.update());
    if (!this.truth || this.pair.length < 2) own.closest("label").remove();
    if (!this.truth) cut.closest("label").remove();
    for (const axis of ["u", "v"]) {
      const slider = part(this.host, `side-slide-${axis}`);
      slider.min = this.group.extent[`${axis}0`];
      slider.max = this.group.extent[`${axis}1`];
      slider.step = "any";
      slider.addEventListener("input", () => { this.cursor[axis] = Number(slider.value); this.update(); });
    }
  }

  follow(heat, event) {
    const place = heat.pick(event);
    if (!place) return;
    this.cursor = place;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.update(); });
  }

  /** Symmetric limits that hold 98 % of the errors of one map. */
  ownSpan(map) {
    const sizes = Array.from(map.layers.error).filter(Number.isFinite).map(Math.abs).sort((a, b) => a - b);
    const most = Math.max(1e-3, sizes.length ? sizes[Math.floor(0.98 * (sizes.length - 1))] : 1);
    return [-most, most];
  }

  spanOf(name, map) {
    const own = part(this.host, "own-scale");
    return name === "error" && own && own.checked ? this.ownSpan(map) : this.group.spans[name] || [0, 1];
  }

  update() {
    for (const { name, layer, figures, scale } of this.rows) {
      for (const one of figures) this.drawFigure(one);
      const own = part(this.host, "own-scale");
      if (layer.words) this.drawWords(scale, figures);
      else if (name === "error" && own && own.checked) scale.replaceChildren("each on its own scale, see below it");
      else drawScale(scale, layer, this.group.spans[name] || [0, 1], this.group.words);
    }
    this.drawCuts();
  }

  drawFigure({ map, name, heat, value }) {
    const layer = LAYERS[name], cell = cellAt(map, this.cursor.u, this.cursor.v), span = this.spanOf(name, map);
    heat.cursor = this.cursor;
    heat.show({ map, values: map.layers[name] }, layer, span);
    const at = cell < 0 ? NaN : map.layers[name][cell], own = part(this.host, "own-scale");
    const limits = name === "error" && own && own.checked ? ` (scale ± ${number(span[1], 2, "mm")})` : "";
    const text = layer.words ? this.group.words[layer.words][at] || "" : name === "error" ? signed(at, this.group.digits, layer.unit) : number(at, layer.digits, layer.unit);
    value.textContent = (cell < 0 ? "" : text) + limits;
  }

  drawWords(scale, figures) {
    const used = new Set();
    for (const { map } of figures) for (const code of map.layers.regime) if (code) used.add(code);
    const words = this.group.words;
    scale.replaceChildren(...[...used].sort().map((code) => node("span", { class: `patch${code === words.prior ? " hatched" : ""}`, style: `--key:${words.paint.regimes[code]}` }, words.regimes[code])));
  }

  drawCuts() {
    const chosen = part(this.host, "cut-of"), layer = chosen ? chosen.value : "height";
    const colours = [styleOf(this.host, "--accent"), "#d55e00"];
    for (const chart of this.cuts) {
      const other = chart.along === "u" ? "v" : "u", at = this.cursor[other];
      const series = this.pair.map((map, k) => ({ label: map.label, kind: k ? "other" : "chosen", colour: colours[k], dashed: false, banded: true, ...cutThrough(map, chart.along, at, layer) }));
      if (this.truth) series.push({ label: this.truth.label, kind: "truth", colour: styleOf(this.host, "--ink"), dashed: false, ...cutThrough(this.truth, chart.along, at, layer) });
      chart.title = layer === "error" ? "error (mm)" : "w (mm)";
      chart.show(series, at, this.cursor[chart.along], layer === "error" ? [0, 0] : this.group.spans.height);
      drawLegend(part(this.host, "side-legend"), series);
      part(this.host, `side-slide-${other}`).value = at;
      part(this.host, `side-at-${other}`).textContent = number(at, 1, "mm");
    }
  }
}
