// Curves as small charts: a line per run (of one run: per kind of energy), a cursor at the clock.
"use strict";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const CURVES = [
  ["total", "energy [J]", 1], ["stretch", "largest stretch [%]", 100],
  ["triangles", "penetration [mm]", 1000], ["contacts", "points in contact", 1],
  ["difference", "rms difference to the first run [mm]", 1000],
];
const FEW = 20;  // frames of a run whose curves have marks; up to two frames have marks alone
const LEFT = 58, RIGHT = 10, TOP = 6, BOTTOM = 20;  // pixels beside a chart

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const look = (k) => ({ color: SHADING.colors[k % SHADING.colors.length], dash: DASHES[k % DASHES.length] });
// Black is the colour of the text, which is light on a dark page.
const inked = (color) => (color === "#000000" ? css("--ink") : color);

function drawCurves(runs, seek) {
  const end = Math.max(...runs.map((r) => r.t.at(-1))), begin = Math.min(...runs.map((r) => r.t[0]));
  let charts = [], now = begin;

  function add(label, factor, all, ofPoint = false) {
    const lines = all.filter((line) => line.y);
    if (!lines.length) return;
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    const canvas = document.createElement("canvas");
    caption.textContent = label;
    if (runs.length === 1 && lines.length > 1) for (const line of lines) {
      const key = document.createElement("span");
      key.className = "key";
      key.append(sample(line), line.label);
      caption.append(" ", key);
    }
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${label}. ${lines.map((line) => inWords(line, factor)).join("; ")}`);
    figure.append(caption, canvas);
    $("curves").append(figure);
    let low = 0, high = 0;
    for (const { y } of lines) for (const v of y) if (v !== null) { low = Math.min(low, factor * v); high = Math.max(high, factor * v); }
    if (low === high) high = 1;
    charts.push({ figure, canvas, lines, factor, low, high, ofPoint });
    const at = (e) => begin + (end - begin) * (e.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); seek(at(e)); });
    canvas.addEventListener("pointermove", (e) => { if (e.buttons) seek(at(e)); });
  }

  for (const [name, label, factor] of CURVES) {
    let lines = runs.map((run, k) => ({ t: run.t, y: run.curves[name], label: run.label, ...look(k) }));
    if (runs.length === 1 && name === "total") {
      const kinds = { total: 3, kinetic: 1, elastic: 2, gravity: 0 };  // the colours of Run.plot
      lines = Object.entries(kinds).map(([kind, k]) => ({ t: runs[0].t, y: runs[0].curves[kind], label: kind, ...look(k) }));
    }
    add(label, factor, lines);
  }

  function paint(chart, t) {
    const { canvas } = chart, ratio = window.devicePixelRatio || 1, c = canvas.getContext("2d");
    if (!canvas.clientWidth || !canvas.clientHeight) return;  // not laid out yet, as in a hidden cell of a notebook
    if (!chart.kept || chart.kept.width !== Math.round(canvas.clientWidth * ratio)) {
      drawLines(chart, ratio, begin, end);
      chart.kept = document.createElement("canvas");
      chart.kept.width = canvas.width; chart.kept.height = canvas.height;
      chart.kept.getContext("2d").drawImage(canvas, 0, 0);
    }
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.drawImage(chart.kept, 0, 0);
    c.fillStyle = css("--ink");
    c.fillRect(Math.round(chart.X(t) * ratio) - 1, TOP * ratio, 2, (canvas.clientHeight - TOP - BOTTOM) * ratio);
  }

  return {
    cursor(t) { now = t; charts.forEach((chart) => paint(chart, t)); },
    draw(again = false) { charts.forEach((chart) => { if (again) chart.kept = null; paint(chart, now); }); },
    // Other curves of a point: [label, factor, lines] each.
    replace(found) {
      for (const { figure } of charts.filter((chart) => chart.ofPoint)) figure.remove();
      charts = charts.filter((chart) => !chart.ofPoint);
      for (const one of found) add(...one, true);
      this.draw();
    },
  };
}

function drawLines(chart, ratio, begin, end) {
  const { canvas, lines, factor, low, high } = chart, c = canvas.getContext("2d");
  const width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  c.scale(ratio, ratio);
  const X = chart.X = (time) => LEFT + (width - LEFT - RIGHT) * (time - begin) / (end - begin || 1);
  const Y = (value) => TOP + (height - TOP - BOTTOM) * (high - value) / (high - low);
  c.font = "11px system-ui, sans-serif"; c.fillStyle = css("--soft"); c.strokeStyle = css("--line");
  c.textAlign = "right"; c.textBaseline = "middle";
  for (const value of ticks(low, high)) {
    c.beginPath(); c.moveTo(LEFT, Y(value)); c.lineTo(width - RIGHT, Y(value)); c.stroke();
    c.fillText(String(value), LEFT - 6, Y(value));
  }
  c.textAlign = "center"; c.textBaseline = "top";
  for (const time of ticks(begin, end)) c.fillText(`${time} s`, Math.min(X(time), width - 14), height - BOTTOM + 6);
  for (const { t: times, y, color, dash } of lines) {
    c.strokeStyle = c.fillStyle = inked(color); c.lineWidth = 1.6; c.setLineDash(dash); c.beginPath();
    let pen = false;
    y.forEach((v, k) => {
      if (v === null) { pen = false; return; }
      c[pen ? "lineTo" : "moveTo"](X(times[k]), Y(factor * v));
      pen = true;
    });
    if (times.length > 2) c.stroke();
    c.setLineDash([]);
    if (times.length < FEW) y.forEach((v, k) => {
      if (v === null) return;
      c.beginPath(); c.arc(X(times[k]), Y(factor * v), 3, 0, 2 * Math.PI); c.fill();
    });
  }
}

// A line for readers who cannot see it: where it begins, ends, and is highest and lowest.
function inWords({ t, y, label }, factor) {
  const known = [...y.keys()].filter((k) => y[k] !== null);
  if (!known.length) return `${label}: not known`;
  const most = (sign) => known.reduce((a, b) => (sign * y[b] > sign * y[a] ? b : a));
  const at = (k) => `${Number((factor * y[k]).toPrecision(3))} at ${Number(t[k].toPrecision(3))} s`;
  return `${label}: first ${at(known[0])}, last ${at(known.at(-1))}, highest ${at(most(1))}, lowest ${at(most(-1))}`;
}

// A piece of a curve, which says in a caption whose it is.
function sample({ color, dash }) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(svg.namespaceURI, "line");
  for (const [name, value] of Object.entries({ width: 34, height: 8, "aria-hidden": true })) svg.setAttribute(name, value);
  const stroke = color === "#000000" ? "currentColor" : color;
  const shape = { x1: 1, x2: 33, y1: 4, y2: 4, stroke, "stroke-width": 2.5, "stroke-dasharray": dash.join(" ") };
  for (const [name, value] of Object.entries(shape)) line.setAttribute(name, value);
  svg.append(line);
  return svg;
}

// Three to six round numbers from low to high.
function ticks(low, high) {
  const rough = (high - low) / 3, power = 10 ** Math.floor(Math.log10(rough));
  const by = [1, 2, 5, 10].map((k) => k * power).filter((k) => k <= rough * 1.001).at(-1);
  const found = [];
  for (let k = Math.ceil(low / by - 1e-9); k * by <= high + 1e-9 * by; k++) found.push(Number((k * by).toPrecision(6)));
  return found;
}
