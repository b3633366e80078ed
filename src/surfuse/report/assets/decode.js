/* Packed numbers of the page: base64 of little-endian arrays, or one constant. No value is NaN. */

const VIEWS = { f4: Float32Array, u2: Uint16Array, u1: Uint8Array };
const NO_SHARE = 65535;

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

/** n numbers as a typed array; null where the page has no such layer. */
function unpack(packed, n) {
  if (!packed) return null;
  let values;
  if (packed.t === "c") {
    values = new Float32Array(n).fill(packed.v === null ? NaN : packed.v);
  } else {
    const bytes = bytesOf(packed.b);
    values = new VIEWS[packed.t](bytes.buffer);
  }
  if (packed.s === undefined) return values;
  return Float32Array.from(values, (step) => (step === NO_SHARE ? NaN : (packed.s * step) / 65534));
}

function readMap(raw) {
  const n = raw.nu * raw.nv;
  const layers = {};
  for (const name of Object.keys(raw.layers)) layers[name] = unpack(raw.layers[name], n);
  return {
    label: raw.label, truth: raw.truth, stride: raw.stride, nu: raw.nu, nv: raw.nv,
    u: unpack(raw.u, raw.nu), v: unpack(raw.v, raw.nv), layers,
  };
}

function readStops(raw) {
  if (!raw) return null;
  const m = raw.stop.length, n = raw.sensor.length;
  const stops = { count: m, stride: raw.stride, sensors: raw.sensors, stop: raw.stop, row: raw.row, start: raw.start, sensor: raw.sensor };
  for (const name of ["u", "v", "depth", "sigma", "gap", "reset"]) stops[name] = unpack(raw[name], m);
  for (const name of ["gate", "dc", "dc1", "dc2", "dc3", "range"]) stops[name] = unpack(raw[name], n);
  stops.side = spacing(stops);
  return stops;
}

/** Median distance to the nearest other stop, from a sample. */
function spacing(stops) {
  const near = [];
  const skip = Math.max(1, Math.floor(stops.count / 150));
  for (let i = 0; i < stops.count; i += skip) {
    let best = Infinity;
    for (let j = 0; j < stops.count; j++) {
      const d = Math.hypot(stops.u[i] - stops.u[j], stops.v[i] - stops.v[j]);
      if (d > 1e-3 && d < best) best = d;
    }
    if (best < Infinity) near.push(best);
  }
  near.sort((a, b) => a - b);
  return near.length ? near[near.length >> 1] : 10;
}

function nearestIndex(nodes, value) {
  let best = 0;
  for (let i = 1; i < nodes.length; i++) if (Math.abs(nodes[i] - value) < Math.abs(nodes[best] - value)) best = i;
  return best;
}

/** Index of the cell of a map nearest to (u, v) in mm, or -1 outside of its nodes by more than half a cell. */
function cellAt(map, u, v) {
  const i = nearestIndex(map.u, u), j = nearestIndex(map.v, v);
  const half = (nodes, k) => (nodes.length < 2 ? Infinity : 0.51 * Math.abs(nodes[Math.min(k + 1, nodes.length - 1)] - nodes[Math.max(k - 1, 0)]));
  if (Math.abs(map.u[i] - u) > half(map.u, i) || Math.abs(map.v[j] - v) > half(map.v, j)) return -1;
  return j * map.nu + i;
}

function nearestStop(stops, u, v) {
  let best = -1, least = Infinity;
  for (let k = 0; k < stops.count; k++) {
    const d = Math.hypot(stops.u[k] - u, stops.v[k] - v);
    if (d < least) { least = d; best = k; }
  }
  return least < 1.5 * stops.side ? best : -1;
}
