// Curves as small charts: a line per run (of one run: per kind of energy), a cursor at the clock.
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const CURVES = [
  ["total", "energy [J]", 1],
  ["stretch", "largest stretch [%]", 100],
  ["triangles", "penetration [mm]", 1000],
  ["contacts", "points in contact", 1],
  ["difference", "rms difference to the first run [mm]", 1000],
];
const FEW = 20;  // frames of a run whose curves have marks; up to two frames have marks alone
const LEFT = 58;
const RIGHT = 10;
const TOP = 6;
const BOTTOM = 20;  // pixels beside a chart

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const look = (k) =>
    ({color: SHADING.colors[k % SHADING.colors.length], dash: DASHES[k % DASHES.length]});
// Black is the colour of the text, which is light on a dark page.
const inkOf = (color) => (color === "#000000" ? css("--ink") : color);

function drawCurves(runs, seek) {
  const begin = () => Math.min(...runs.map((r) => r.t[0]));
  const end = () => Math.max(...runs.map((r) => r.t.at(-1)));
  let charts = [];
  let cursorTime = 0;
  function add(label, factor, all, ofPoint = false) {
    const lines = all.filter((line) => line.y || line.of);
    if (!lines.length) return;
    const [figure, caption, canvas] =
        ["figure", "figcaption", "canvas"].map((name) => document.createElement(name));
    caption.append(label);
    if (runs.length === 1 && lines.length > 1)
      for (const line of lines) {
        const key = Object.assign(sample(line), {className: "key"});
        key.append(line.label);
        caption.append(" ", key);
      }
    canvas.setAttribute("role", "img");
    figure.append(caption, canvas);
    $("curves").append(figure);
    charts.push({figure, canvas, lines, label, factor, ofPoint});
    measure(charts.at(-1));
    const at = (e) =>
        begin() + (end() - begin()) * (e.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      seek(at(e));
    });
    canvas.addEventListener("pointermove", (e) => {
      if (e.buttons) seek(at(e));
    });
  }
  // A chart of its lines as they are cursorTime; `of` computes the values of a line anew.
  function measure(chart) {
    const {canvas, lines, label, factor} = chart;
    for (const line of lines) line.y = line.of?.() ?? line.y;
    const values = lines.flatMap(({y}) => y.map((v) => factor * v));  // null counts as 0
    const low = values.reduce((a, b) => Math.min(a, b), 0);
    const high = values.reduce((a, b) => Math.max(a, b), 0);
    Object.assign(chart, {low, high: high === low ? 1 : high});
    canvas.setAttribute(
        "aria-label", `${label}. ${lines.map((line) => inWords(line, factor)).join("; ")}`);
  }
  for (const [name, label, factor] of CURVES) {
    let lines =
        runs.map((run, k) => ({t: run.t, y: run.curves[name], label: run.label, ...look(k)}));
    if (runs.length === 1 && name === "total") {
      const kinds = {total: 3, kinetic: 1, elastic: 2, gravity: 0};  // the colours of Run.plot
      lines = Object.entries(kinds).map(
          ([kind, k]) => ({t: runs[0].t, y: runs[0].curves[kind], label: kind, ...look(k)}));
    }
    add(label, factor, lines);
  }
  return {
    cursor(t) {
      cursorTime = t;
      this.draw();
    },
    draw() {
      charts.forEach((chart) => drawChart(chart, begin(), end(), cursorTime));
    },
    grow() {
      charts.forEach(measure);
      this.draw();
    },
    // Other curves of a point: [label, factor, lines] each.
    replace(curves) {
      for (const {figure} of charts.filter((chart) => chart.ofPoint)) figure.remove();
      charts = charts.filter((chart) => !chart.ofPoint);
      for (const curve of curves) add(...curve, true);
      this.draw();
    },
  };
}

function drawChart({canvas, lines, factor, low, high}, begin, end, cursorTime) {
  const {clientWidth: width, clientHeight: height} = canvas;
  const c = canvas.getContext("2d");
  const ratio = window.devicePixelRatio || 1;
  if (!width || !height) return;  // not laid out yet, as in a hidden cell of a notebook
  Object.assign(canvas, {width: Math.round(width * ratio), height: Math.round(height * ratio)});
  c.scale(ratio, ratio);
  const X = (time) => LEFT + (width - LEFT - RIGHT) * (time - begin) / (end - begin || 1);
  const Y = (value) => TOP + (height - TOP - BOTTOM) * (high - value) / (high - low);
  c.font = "11px system-ui, sans-serif";
  c.fillStyle = css("--soft");
  c.strokeStyle = css("--line");
  c.textAlign = "right";
  c.textBaseline = "middle";
  for (const value of ticks(low, high)) {
    c.beginPath();
    c.moveTo(LEFT, Y(value));
    c.lineTo(width - RIGHT, Y(value));
    c.stroke();
    const text = String(value);
    const wide = c.measureText(text).width > LEFT - 8;  // its sign would be cut off
    c.fillText(wide ? value.toExponential() : text, LEFT - 6, Y(value));
  }
  c.textAlign = "center";
  c.textBaseline = "top";
  for (const time of ticks(begin, end))
    c.fillText(`${time} s`, Math.min(X(time), width - 14), height - BOTTOM + 6);
  for (const {t: times, y, color, dash} of lines) {
    c.strokeStyle = c.fillStyle = inkOf(color);
    c.lineWidth = 1.6;
    c.setLineDash(dash);
    c.beginPath();
    y.forEach((v, k) => {
      if (v !== null)
        c[(y[k - 1] ?? null) === null ? "moveTo" : "lineTo"](X(times[k]), Y(factor * v));
    });
    if (times.length > 2) c.stroke();
    c.setLineDash([]);
    if (times.length < FEW)
      y.forEach((v, k) => {
        if (v === null) return;
        c.beginPath();
        c.arc(X(times[k]), Y(factor * v), 3, 0, 2 * Math.PI);
        c.fill();
      });
  }
  c.fillStyle = css("--ink");
  c.fillRect(X(cursorTime) - 1, TOP, 1.5, height - TOP - BOTTOM);
}
// A line for readers who cannot see it: where it begins, ends, and is highest and lowest.
function inWords({t, y, label}, factor) {
  const places = [...y.keys()].filter((k) => y[k] !== null);
  if (!places.length) return `${label}: not known`;
  const most = (sign) => places.reduce((a, b) => (sign * y[b] > sign * y[a] ? b : a));
  const at = (k) => `${Number((factor * y[k]).toPrecision(3))} at ${Number(t[k].toPrecision(3))} s`;
  return `${label}: first ${at(places[0])}, last ${at(places.at(-1))}, highest ${
      at(most(1))}, lowest ${at(most(-1))}`;
}
// A piece of a curve, which says in a caption whose it is.
function sample({color, dash}) {
  const key = document.createElement("span");
  const stroke = color === "#000000" ? "currentColor" : color;
  key.innerHTML =
      `<svg width="34" height="8" aria-hidden="true"><line x1="1" x2="33" y1="4" y2="4" stroke="${
          stroke}" ` +
      `stroke-width="2.5" stroke-dasharray="${dash.join(" ")}"></line></svg>`;
  return key;
}
// Three to six round numbers from low to high.
function ticks(low, high) {
  const rough = (high - low) / 3;
  const power = 10 ** Math.floor(Math.log10(rough));
  const by = [1, 2, 5, 10].map((k) => k * power).filter((k) => k <= rough * 1.001).at(-1);
  const values = [];
  for (let k = Math.ceil(low / by - 1e-9); k * by <= high + 1e-9 * by; k++)
    values.push(Number((k * by).toPrecision(6)));
  return values;
}
