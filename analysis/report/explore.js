// Shows the data of explore.html with plotly.js. Exceedance probabilities follow analysis/pdem/tails.py.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const OUTERMOST = 3, END = 36.0; // as in analysis/pdem/tails.py
const title = (text) => ({text, font: {size: 13}, x: 0.02, xanchor: "left"});
const LOOK = {margin: {l: 62, r: 14, t: 34, b: 46}, font: {size: 12}, showlegend: false, hovermode: "closest"};
const OPTIONS = {displayModeBar: false, responsive: true};
const INK = "#00316e", SOFT = "#9aa4b2";

// ---- arrays ----

const unpacked = new Map();

// Float32 numbers of a base64 text; unpacked once.
function numbers(text) {
  if (!unpacked.has(text)) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    unpacked.set(text, new Float32Array(bytes.buffer));
  }
  return unpacked.get(text);
}

// Row k of an array of so many columns.
function row(text, k, columns) {
  return numbers(text).subarray(k * columns, (k + 1) * columns);
}

// ---- statistics of the points ----

// Values of the points that have one, ascending, with normalised probabilities.
function sorted(values, probability) {
  const known = [];
  for (let q = 0; q < values.length; q++) {
    if (Number.isFinite(values[q]) && probability[q] > 0) known.push([values[q], probability[q]]);
  }
  known.sort((a, b) => a[0] - b[0]);
  const total = known.reduce((sum, point) => sum + point[1], 0);
  return {x: known.map((p) => p[0]), p: known.map((p) => p[1] / total)};
}

// ln 2F below the median, -ln 2(1 - F) above it.
function logTail(below, above) {
  return below < 0.5 ? Math.log(2 * below) : -Math.log(2 * above);
}

function meanExcess(x, p, from, indices) {
  let weight = 0, sum = 0;
  for (const k of indices) { weight += p[k]; sum += p[k] * Math.abs(x[k] - from); }
  return sum / weight;
}

// Values and logarithms of the tail probability at the points and at the ends of the exponential tails.
function tailCurve({x, p}) {
  if (!x.length) return {x: [NaN], tail: [NaN]}; // no test goes on
  const n = x.length, count = Math.min(OUTERMOST, n - 1);
  let scales = [0, 0];
  if (count > 0) {
    const first = [...Array(count).keys()], last = first.map((k) => n - count + k);
    scales = [meanExcess(x, p, x[count], first), meanExcess(x, p, x[n - count - 1], last)];
  }
  const above = Array(n);
  let sum = 0;
  for (let k = n - 1; k >= 0; k--) { sum += p[k]; above[k] = sum; }
  sum = 0;
  const tail = x.map((_, k) => { sum += p[k]; return logTail(sum - 0.5 * p[k], above[k] - 0.5 * p[k]); });
  return {x: [x[0] - END * scales[0], ...x, x[n - 1] + END * scales[1]],
          tail: [tail[0] - END, ...tail, tail[n - 1] + END]};
}

function interpolated(at, x, y) {
  if (!(at > x[0])) return y[0];
  for (let k = 1; k < x.length; k++) {
    if (at < x[k]) return y[k - 1] + (y[k] - y[k - 1]) * (at - x[k - 1]) / (x[k] - x[k - 1]);
  }
  return y[y.length - 1];
}

// Probability that the response exceeds a threshold.
function exceedance(curve, threshold) {
  const at = interpolated(threshold, curve.x, curve.tail);
  return at < 0 ? 1 - 0.5 * Math.exp(at) : 0.5 * Math.exp(-at);
}

function moments({x, p}) {
  if (!x.length) return [NaN, NaN];
  const mean = x.reduce((sum, v, k) => sum + p[k] * v, 0);
  const variance = x.reduce((sum, v, k) => sum + p[k] * (v - mean) ** 2, 0);
  return [mean, Math.sqrt(Math.max(variance, 0))];
}

// ---- what is chosen ----

const chosen = {};

function options(id, items) {
  const before = element(id).value;
  element(id).replaceChildren(...items.map(([value, text]) => new Option(text, value)));
  if (items.some(([value]) => String(value) === before)) element(id).value = before;
}

function choose() {
  chosen.set = data.sets[Number(element("set").value)];
  const kinds = data.kinds.filter((kind) => Object.keys(chosen.set.kinds[kind]).length);
  options("kind", kinds.map((kind) => [kind, kind]));
  chosen.kind = element("kind").value;
  const there = data.responses.filter((symbol) => symbol in chosen.set.kinds[chosen.kind]);
  options("response", there.map((symbol) => [symbol, `${data.quantities[symbol].name} (${symbol})`]));
  chosen.symbol = element("response").value;
  options("second", there.filter((s) => s !== chosen.symbol).map((s) => [s, data.quantities[s].name]));
  chosen.second = element("second").value;
  chosen.colour = element("colour").value;
  chosen.k = Number(element("strain").value);
  chosen.response = chosen.set.kinds[chosen.kind][chosen.symbol];
  chosen.count = chosen.set.probability.length;
  chosen.values = row(chosen.response.values, chosen.k, chosen.count);
  chosen.points = sorted(chosen.values, chosen.set.probability);
  chosen.curve = tailCurve(chosen.points);
}

// Values at the chosen strain of any response of the chosen set.
function valuesOf(symbol) {
  return row(chosen.set.kinds[chosen.kind][symbol].values, chosen.k, chosen.count);
}

function label(symbol) { return data.quantities[symbol].label; }

function shown(value, digits = 4) {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "-";
}

// The centres and densities of the PDF at the chosen strain.
function pdf() {
  const of = chosen.response, cells = numbers(of.pdf).length / data.strain.length;
  const y = row(of.pdf, chosen.k, cells);
  return {x: Array.from(y, (_, j) => of.first[chosen.k] + j * of.width[chosen.k]), y: Array.from(y)};
}

function marker(size, withScale = false) {
  const of = chosen.set.inputs[chosen.colour], title = data.quantities[chosen.colour].label;
  return {size, color: of, colorscale: "Cividis", showscale: withScale, line: {width: 0.5, color: "white"},
          colorbar: {title: {text: title, side: "right"}, thickness: 12}};
}

function hint() {
  return chosen.set.id.map((id, q) => `point ${id}` + data.inputs.map(
    (name) => `<br>${name} = ${shown(chosen.set.inputs[name][q])} ${data.quantities[name].unit}`).join("")
    + `<br>probability ${shown(chosen.set.probability[q], 3)}`);
}

// ---- drawing ----

function drawAlong() {
  const T = data.strain.length, mean = [], low = [], high = [], traces = [];
  for (let k = 0; k < T; k++) {
    const [m, s] = moments(sorted(row(chosen.response.values, k, chosen.count), chosen.set.probability));
    mean.push(gap(m)); low.push(gap(m - s)); high.push(gap(m + s));
  }
  const x = [], y = [];
  for (let q = 0; q < chosen.count; q++) {
    for (let k = 0; k < T; k++) { x.push(data.strain[k]); y.push(gap(row(chosen.response.values, k, chosen.count)[q])); }
    x.push(null); y.push(null);
  }
  traces.push({x, y, mode: "lines", line: {color: SOFT, width: 0.5}, opacity: 0.5, hoverinfo: "skip"});
  traces.push({x: data.strain, y: low, mode: "lines", line: {color: INK, width: 1, dash: "dot"}, hoverinfo: "skip"});
  traces.push({x: data.strain, y: high, mode: "lines", line: {color: INK, width: 1, dash: "dot"}, hoverinfo: "skip"});
  traces.push({x: data.strain, y: mean, mode: "lines", line: {color: INK, width: 2.5}, hoverinfo: "x+y"});
  traces.push(pointsAtStrain());
  Plotly.react("along", traces, {...LOOK, title: title("Points, mean, one standard deviation"),
    xaxis: {title: `${data.axial} (%)`}, yaxis: {title: label(chosen.symbol)}, shapes: [strainLine()]}, OPTIONS);
}

function gap(value) { return Number.isFinite(value) ? value : null; }

function pointsAtStrain() {
  return {x: Array(chosen.count).fill(data.strain[chosen.k]), y: Array.from(chosen.values), mode: "markers",
          marker: marker(6), text: hint(), hovertemplate: "%{text}<extra></extra>"};
}

function strainLine() {
  const at = data.strain[chosen.k];
  return {type: "line", x0: at, x1: at, yref: "paper", y0: 0, y1: 1, line: {color: "#b00040", width: 1.5}};
}

function thresholdLine() {
  return {type: "line", x0: chosen.threshold, x1: chosen.threshold, yref: "paper", y0: 0, y1: 1,
          line: {color: "#b00040", width: 1.5}};
}

function span() {
  const {x, y} = chosen.pdf, top = Math.max(...y);
  const inside = x.filter((_, j) => top === 0 || y[j] > 1e-3 * top); // all zero: no test goes on
  return [inside[0] - 3 * chosen.response.width[chosen.k], inside[inside.length - 1] + 3 * chosen.response.width[chosen.k]];
}

function drawPdf() {
  const {x, y} = chosen.pdf, unit = data.quantities[chosen.symbol].unit;
  const base = -0.04 * Math.max(...y);
  Plotly.react("pdf", [
    {x, y, mode: "lines", fill: "tozeroy", line: {color: INK, width: 2}, fillcolor: "rgba(0,49,110,0.12)", hoverinfo: "skip"},
    {x: Array.from(chosen.values), y: Array(chosen.count).fill(base), mode: "markers",
     marker: {...marker(9), symbol: "line-ns-open"}, text: hint(), hovertemplate: "%{text}<extra></extra>"},
  ], {...LOOK, title: title(`PDF at ${shown(data.strain[chosen.k], 3)} % strain`),
    xaxis: {title: label(chosen.symbol), range: span()},
    yaxis: {title: "Probability density" + (unit ? ` (1/${unit})` : "")}, shapes: [thresholdLine()]}, OPTIONS);
}

function drawCdf() {
  const [low, high] = span(), x = [], y = [];
  for (let j = 0; j <= 300; j++) {
    x.push(low + (high - low) * j / 300);
    y.push(1 - exceedance(chosen.curve, x[j]));
  }
  Plotly.react("cdf", [{x, y, mode: "lines", line: {color: INK, width: 2}, hoverinfo: "skip"}],
    {...LOOK, title: title("Distribution function"), xaxis: {title: label(chosen.symbol), range: [low, high]},
     yaxis: {title: "Probability of a smaller value", range: [-0.02, 1.02]}, shapes: [thresholdLine()]}, OPTIONS);
}

// Product kernels at the points, with the widths of analysis/pdem/joint_pdf.py.
function drawJoint() {
  const second = chosen.second;
  if (!second || !chosen.points.x.length) { Plotly.purge("joint"); return; }
  const one = chosen.values, two = valuesOf(second), P = chosen.set.probability, known = [];
  for (let q = 0; q < P.length; q++) {
    if (Number.isFinite(one[q]) && Number.isFinite(two[q]) && P[q] > 0) known.push(q);
  }
  const total = known.reduce((sum, q) => sum + P[q], 0), p = known.map((q) => P[q] / total);
  const a = known.map((q) => one[q]), b = known.map((q) => two[q]);
  const [m1, s1] = moments({x: a, p}), [m2, s2] = moments({x: b, p});
  const rho = s1 > 0 && s2 > 0 ? p.reduce((sum, w, k) => sum + w * (a[k] - m1) * (b[k] - m2), 0) / (s1 * s2) : 0;
  const factor = 3.5 * Math.sqrt(p.reduce((sum, w) => sum + w * w, 0)) * Math.max(1 - rho * rho, 0) ** 0.25;
  const w1 = kernelWidth(factor * s1, chosen.response, s1), w2 = kernelWidth(factor * s2, chosen.set.kinds[chosen.kind][second], s2);
  const traces = [];
  if (s1 > 0 && s2 > 0) {
    const N = 61, gx = axis(a, w1, N), gy = axis(b, w2, N), k1 = kernels(gx, a, w1), k2 = kernels(gy, b, w2);
    const z = gy.map((_, i) => gx.map((_, j) => p.reduce((sum, w, q) => sum + w * k1[j][q] * k2[i][q], 0)));
    traces.push({type: "contour", x: gx, y: gy, z, colorscale: [[0, "#ffffff"], [1, "#5f86b8"]], showscale: false, ncontours: 9,
                 contours: {coloring: "fill"}, line: {width: 0}, hoverinfo: "skip"});
  }
  traces.push({x: Array.from(one), y: Array.from(two), mode: "markers", marker: marker(7, true), text: hint(),
               hovertemplate: "%{text}<extra></extra>"});
  Plotly.react("joint", traces, {...LOOK, title: title(`Joint density; correlation ${shown(rho, 3)}`),
    xaxis: {title: label(chosen.symbol)}, yaxis: {title: label(second)}}, OPTIONS);
}

function kernelWidth(width, response, spread) {
  return Math.max(Math.min(width, response.bandwidth[chosen.k] || width), 0.02 * spread);
}

function axis(values, width, count) {
  const low = Math.min(...values) - 3 * width, high = Math.max(...values) + 3 * width;
  return Array.from({length: count}, (_, j) => low + (high - low) * j / (count - 1));
}

function kernels(grid, values, width) {
  return grid.map((g) => values.map((v) => Math.exp(-0.5 * ((g - v) / width) ** 2) / (width * Math.sqrt(2 * Math.PI))));
}

// ---- reading off ----

function readOff() {
  if (!chosen.points.x.length) {
    element("readout").textContent = `No test goes on to ${shown(data.strain[chosen.k], 3)} % strain (${chosen.set.name})`;
    return;
  }
  const p = exceedance(chosen.curve, chosen.threshold), [mean, sd] = moments(chosen.points);
  const unit = data.quantities[chosen.symbol].unit, out = element("readout");
  out.dataset.threshold = chosen.threshold;
  out.dataset.exceedance = p;
  out.innerHTML = "";
  const strong = document.createElement("b");
  strong.textContent = `P(${chosen.symbol} > ${shown(chosen.threshold)}${unit ? " " + unit : ""}) = ${shown(p, 3)}`;
  out.append(strong, ` at ${shown(data.strain[chosen.k], 3)} % strain; mean ${shown(mean)}, standard deviation ${shown(sd, 3)}`
    + ` (${chosen.kind}, ${chosen.set.name}${goingOn()})`);
}

// For which probability a number holds, if tests have ended before the chosen strain.
function goingOn() {
  let sum = 0;
  chosen.set.probability.forEach((p, q) => { if (Number.isFinite(chosen.values[q])) sum += p; });
  return sum > 0.999 ? "" : `; of the tests that go on, ${shown(100 * sum, 3)} % of the probability`;
}

function setThreshold(value, fromInput = false) {
  if (!Number.isFinite(value)) return;
  chosen.threshold = value;
  if (!fromInput) element("threshold").value = Number(value.toPrecision(6));
  for (const id of ["pdf", "cdf"]) Plotly.relayout(id, {shapes: [thresholdLine()]});
  readOff();
}

// Calls `then` with the value on the x axis below the pointer.
function onPointer(id, event, then) {
  const plot = element(id);
  plot.addEventListener(event, (e) => {
    const layout = plot._fullLayout, box = plot.getBoundingClientRect();
    const inside = e.clientX - box.left - layout.xaxis._offset;
    if (inside >= 0 && inside <= layout.xaxis._length) then(layout.xaxis.p2d(inside));
  });
}

function setStrain(percent) {
  const off = data.strain.map((s) => Math.abs(s - percent));
  element("strain").value = off.indexOf(Math.min(...off));
  drawAtStrain();
}

function drawAtStrain() {
  choose();
  element("strain-shown").textContent = `${shown(data.strain[chosen.k], 4)} %`;
  chosen.pdf = pdf();
  drawPdf();
  drawCdf();
  drawJoint();
  Plotly.react("along", [...element("along").data.slice(0, 4), pointsAtStrain()],
               {...element("along").layout, shapes: [strainLine()]}, OPTIONS);
  readOff();
}

// The mean at the chosen strain, or at the last one before it at which a test goes on.
function firstMean() {
  for (let k = chosen.k; k >= 0; k--) {
    const points = sorted(row(chosen.response.values, k, chosen.count), chosen.set.probability);
    if (points.x.length) return moments(points)[0];
  }
  return NaN;
}

function drawAll() {
  choose();
  chosen.threshold = chosen.threshold ?? NaN;
  if (chosen.drawn !== chosen.symbol) { // a threshold of another response has no meaning
    chosen.threshold = Number(firstMean().toPrecision(4));
    element("threshold").value = chosen.threshold;
    chosen.drawn = chosen.symbol;
  }
  drawAlong();
  drawAtStrain();
}

options("set", data.sets.map((set, k) => [k, set.name]));
options("colour", data.inputs.map((name) => [name, data.quantities[name].label]));
element("strain").max = data.strain.length - 1;
element("strain").value = data.strain.length - 1;
drawAll();
for (const id of ["response", "set", "kind"]) element(id).addEventListener("change", drawAll);
for (const id of ["colour", "second"]) element(id).addEventListener("change", drawAll);
element("strain").addEventListener("input", drawAtStrain);
element("threshold").addEventListener("input", () => setThreshold(Number(element("threshold").value), true));
for (const id of ["pdf", "cdf"]) onPointer(id, "mousemove", (x) => setThreshold(x));
onPointer("along", "click", setStrain);
document.body.dataset.ready = "yes";
