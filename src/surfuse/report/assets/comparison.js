/* Several methods on the readings of one scene: small maps with one cursor, and a cut through all of them. */

class Comparison {
  constructor(host, group) {
    this.host = host;
    this.group = group;
    this.along = host.dataset.along;
    this.other = this.along === "u" ? "v" : "u";
    const e = group.extent, at = Number(host.dataset.at);
    this.cursor = { [this.along]: 0.5 * (e[`${this.along}0`] + e[`${this.along}1`]), [this.other]: at };
    const palette = group.words.categories.slice(0, 7);
    let rank = 0;
    group.colourOf = group.maps.map((map) => (map.truth ? null : palette[rank++ % palette.length]));
    this.makeMultiples();
    this.chart = new CutChart(part(host, "cut"), this.along, e, group.words.prior);
    this.fillControls();
    this.update();
  }

  fillControls() {
    const names = ["height", "error", "sigma", "confidence"].filter((name) => this.group.maps.some((map) => !map.truth && map.layers[name]));
    const layer = part(this.host, "layer"), slider = part(this.host, "slide");
    fillSelect(layer, names.map((name) => [name, LAYERS[name].unit ? `${LAYERS[name].title} (${LAYERS[name].unit})` : LAYERS[name].title]));
    layer.addEventListener("change", () => this.update());
    slider.min = this.group.extent[`${this.other}0`];
    slider.max = this.group.extent[`${this.other}1`];
    slider.step = "any";
    slider.addEventListener("input", () => { this.cursor[this.other] = Number(slider.value); this.update(); });
  }

  makeMultiples() {
    this.heats = this.group.maps.map((map) => {
      const canvas = node("canvas", { role: "img", "aria-label": `Map: ${map.label}` });
      const value = node("span", { class: "value" });
      const figure = node("figure", {}, canvas, node("figcaption", {}, node("strong", {}, soft(map.label)), value));
      part(this.host, "multiples").append(figure);
      const heat = new Heatmap(canvas, this.group.extent, this.group.words, true);
      canvas.addEventListener("pointermove", (event) => { if (event.pointerType !== "touch") this.follow(heat, event); });
      canvas.addEventListener("click", (event) => this.follow(heat, event));
      return { map, heat, value };
    });
  }

  follow(heat, event) {
    const place = heat.pick(event);
    if (!place) return;
    this.cursor = place;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.update(); });
  }

  update() {
    const name = part(this.host, "layer").value, layer = LAYERS[name], span = this.group.spans[name] || [0, 1];
    for (const { map, heat, value } of this.heats) {
      const used = map.layers[name] ? name : "height", cell = cellAt(map, this.cursor.u, this.cursor.v);
      heat.cursor = this.cursor;
      heat.show({ map, values: map.layers[used] }, LAYERS[used], used === name ? span : this.group.spans.height);
      value.textContent = cell < 0 ? "" : number(map.layers[used][cell], Math.max(LAYERS[used].digits, used === "confidence" ? 0 : this.group.digits), LAYERS[used].unit);
    }
    drawScale(part(this.host, "scale"), layer, span, this.group.words);
    const at = this.cursor[this.other], series = seriesOf(this.group, -1, this.along, at, this.chart.host);
    this.chart.show(series, at, this.cursor[this.along], this.group.spans.height);
    drawLegend(part(this.host, "legend"), series);
    part(this.host, "slide").value = at;
    part(this.host, "at").textContent = number(at, 1, "mm");
  }
}

/** The one colour bar of all small maps, as a strip with its limits. */
function drawScale(host, layer, span, words) {
  const stops = words.colours[layer.colours].map((colour, k, all) => `${rgb(colour)} ${(100 * k) / (all.length - 1)}%`);
  const strip = node("span", { class: "strip", style: `background:linear-gradient(to right,${stops.join(",")})` });
  host.replaceChildren(number(span[0], layer.digits), strip, number(span[1], layer.digits, layer.unit));
}
