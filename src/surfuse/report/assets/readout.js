/* What is known of the place under the cursor: all maps, and why the nearest stop has its value. */

function mapTable(group, chosen, cursor) {
  const truth = group.maps.find((map) => map.truth);
  const trueCell = truth ? cellAt(truth, cursor.u, cursor.v) : -1;
  const trueHeight = trueCell < 0 ? NaN : truth.layers.height[trueCell];
  const head = ["map", "w (mm)", "σ (mm)"].concat(truth ? ["error (mm)"] : []);
  const body = group.maps.map((map, k) => {
    const cell = cellAt(map, cursor.u, cursor.v), has = cell >= 0;
    const error = has && map.layers.error ? map.layers.error[cell] : NaN;
    const cells = [soft(map.label), has ? number(map.layers.height[cell], group.digits) : "outside", has && map.layers.sigma ? number(map.layers.sigma[cell], 3) : ""];
    if (truth) cells.push(map.truth || !has ? "" : signed(error, group.digits));
    return node("tr", k === chosen ? { class: "chosen" } : {}, ...cells.map((text, c) => node(c ? "td" : "th", c ? {} : { scope: "row" }, text)));
  });
  return node("table", { class: "small" }, node("thead", {}, node("tr", {}, ...head.map((t) => node("th", { scope: "col" }, t)))), node("tbody", {}, ...body));
}

function cellFacts(group, map, cursor) {
  const cell = cellAt(map, cursor.u, cursor.v), facts = [];
  if (cell < 0 || map.truth) return facts;
  const { confidence, count, regime } = map.layers;
  if (confidence) facts.push(`confidence ${number(confidence[cell], 2)}`);
  if (count) facts.push(`${count[cell]} ${count[cell] === 1 ? "reading" : "readings"}`);
  if (regime) facts.push(group.words.regimes[regime[cell]]);
  return facts;
}

function sensorTable(stops, words, k) {
  const head = ["sensor"].concat(stops.range ? ["range (mm)"] : [], ["dc1", "dc2", "dc3", "dc"]);
  const rows = [];
  for (let n = stops.start[k]; n < stops.start[k + 1]; n++) {
    const name = stops.sensors[stops.sensor[n]] || `sensor ${stops.sensor[n]}`;
    const cells = [node("th", { scope: "row" }, name)];
    if (stops.range) cells.push(node("td", {}, number(stops.range[n], 1)));
    if (stops.gate[n]) cells.push(node("td", { colspan: 4, class: "gated" }, `kept out: ${words.gates[stops.gate[n]]}`));
    else for (const factor of ["dc1", "dc2", "dc3", "dc"]) {
      const share = stops[factor][n];
      cells.push(node("td", { class: "share", style: `--share:${Number.isNaN(share) ? 0 : share}` }, Number.isNaN(share) ? "–" : share.toFixed(2)));
    }
    rows.push(node("tr", {}, ...cells));
  }
  return node("table", { class: "small" }, node("thead", {}, node("tr", {}, ...head.map((t) => node("th", { scope: "col" }, t)))), node("tbody", {}, ...rows));
}

function stopWords(stops, words, k) {
  const text = [`Stop ${stops.stop[k]}, line ${stops.row[k]}`];
  if (stops.gap[k]) text.push(`gap: ${words.gaps[stops.gap[k]]}`);
  else text.push(`M = ${number(stops.depth[k], 1, "mm")}` + (Number.isFinite(stops.sigma[k]) ? ` ± ${number(stops.sigma[k], 2, "mm")}` : ""));
  if (stops.reset[k]) text.push("prediction started afresh");
  return text.join(" · ");
}

function fillReadout(host, group, chosen, cursor) {
  const parts = [node("p", { class: "place" }, `u = ${number(cursor.u, 1, "mm")}, v = ${number(cursor.v, 1, "mm")}`), mapTable(group, chosen, cursor)];
  const facts = cellFacts(group, group.maps[chosen], cursor);
  if (facts.length) parts.push(node("p", { class: "facts" }, `${group.maps[chosen].label}: ${facts.join(" · ")}`));
  if (group.stops) {
    const k = nearestStop(group.stops, cursor.u, cursor.v);
    if (k < 0) parts.push(node("p", { class: "facts" }, "No stop near this place."));
    else parts.push(node("p", { class: "facts" }, stopWords(group.stops, group.words, k)), sensorTable(group.stops, group.words, k));
  }
  host.replaceChildren(...parts);
}
