/* Colours, round ticks, numbers as text, and small makers of page elements. */

const LAYERS = {
  height: { title: "Height w", unit: "mm", colours: "viridis", digits: 2 },
  error: { title: "Error: map − truth", unit: "mm", colours: "diverging", digits: 2 },
  sigma: { title: "Standard deviation", unit: "mm", colours: "magma", digits: 3, log: true },
  confidence: { title: "Confidence", unit: "", colours: "cividis", digits: 2 },
  count: { title: "Readings per cell", unit: "", colours: "cividis", digits: 0 },
  regime: { title: "Kind of evidence", unit: "", words: "regimes", digits: 0 },
  weight: { title: "Probability of a second surface", unit: "", colours: "cividis", digits: 2 },
  second: { title: "Second surface w", unit: "mm", colours: "viridis", digits: 2 },
};
const STOP_LAYERS = {
  dc: { title: "dc = dc1 · dc2 · dc3", unit: "", colours: "cividis", digits: 2 },
  dc1: { title: "dc1, prediction", unit: "", colours: "cividis", digits: 2 },
  dc2: { title: "dc2, agreement", unit: "", colours: "cividis", digits: 2 },
  dc3: { title: "dc3, boundary", unit: "", colours: "cividis", digits: 2 },
  gate: { title: "Readings kept out", unit: "", colours: "magma", digits: 0 },
  depth: { title: "Fused distance M", unit: "mm", colours: "viridis", digits: 1 },
};

function colourAt(anchors, share) {
  const x = Math.min(1, Math.max(0, share)) * (anchors.length - 1);
  const k = Math.min(anchors.length - 2, Math.floor(x)), t = x - k;
  return [0, 1, 2].map((c) => Math.round(anchors[k][c] + t * (anchors[k + 1][c] - anchors[k][c])));
}

/** Place of a value in a span, 0 to 1; on a logarithmic scale where the layer has one. */
function shareOf(layer, span, value) {
  if (layer.log) return Math.log(Math.max(value, 1e-9) / span[0]) / Math.log(span[1] / span[0] || 1);
  return (value - span[0]) / (span[1] - span[0] || 1);
}

function ticksOf(layer, span, about) {
  if (!layer.log) return roundTicks(span[0], span[1], about);
  const ticks = [], decades = Math.log10(span[1] / span[0]), steps = decades * 3 <= about ? [1, 2, 5] : [1];
  for (let n = Math.floor(Math.log10(span[0])); n <= Math.log10(span[1]); n++)
    for (const step of steps) {
      const tick = step * Math.pow(10, n);
      if (tick >= span[0] * 0.999 && tick <= span[1] * 1.001) ticks.push(tick);
    }
  return ticks;
}

function tickWords(layer, value, ticks) { return layer.log ? String(Number(value.toPrecision(1))) : tickText(value, ticks); }

function rgb(colour) { return `rgb(${colour[0]},${colour[1]},${colour[2]})`; }

function roundTicks(low, high, about) {
  if (!(high > low)) return [low];
  const rough = (high - low) / Math.max(1, about);
  const power = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough * 0.999);
  const ticks = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) ticks.push(n * step);
  return ticks;
}

function tickText(value, ticks) {
  const step = ticks.length > 1 ? Math.abs(ticks[1] - ticks[0]) : 1;
  const digits = Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)));
  return (Math.abs(value) < step * 1e-6 ? 0 : value).toFixed(digits).replace("-", "−");
}

function number(value, digits, unit) {
  if (value === null || value === undefined || Number.isNaN(value)) return "no value";
  if (!Number.isFinite(value)) return value > 0 ? "no echo" : "too close";
  const text = value.toFixed(digits).replace("-", "−");
  return unit ? `${text} ${unit}` : text;
}

function signed(value, digits, unit) {
  const text = number(value, digits, unit);
  return Number.isFinite(value) && value > 0 ? "+" + text : text;
}

function node(tag, attributes, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** A name that may break after an underscore. */
function soft(text) { return text.replaceAll("_", "_\u200b"); }

function svgNode(tag, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function styleOf(element, name) { return getComputedStyle(element).getPropertyValue(name).trim(); }

/** Redraw on a new size, on a change of light and dark, and before printing. */
function redrawWith(element, draw) {
  let width = 0;
  new ResizeObserver(() => {
    if (Math.abs(element.clientWidth - width) < 1) return;
    width = element.clientWidth;
    draw();
  }).observe(element);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("beforeprint", draw);
}

/** A canvas in device pixels with a context in CSS pixels. */
function sharpContext(canvas, width, height) {
  const ratio = Math.min(3, window.devicePixelRatio || 1);
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}
