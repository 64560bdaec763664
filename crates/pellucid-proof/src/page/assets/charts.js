// Charts of the report's figures, drawn anew for every width.

const SVG = "http://www.w3.org/2000/svg";

// Lengths are pixels where the page's text has 16; a chart grows with the text.
const unit = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

class Chart {
  constructor(width, height, label) {
    this.svg = document.createElementNS(SVG, "svg");
    this.set(this.svg, { viewBox: `0 0 ${width} ${height}`, height: height * unit(), role: "img", "aria-label": label });
  }

  set(element, attributes) {
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  }

  add(kind, attributes, text) {
    const element = this.set(document.createElementNS(SVG, kind), attributes);
    if (text !== undefined) element.textContent = text;
    this.svg.append(element);
    return element;
  }

  text(x, y, text, attributes = {}) {
    return this.add("text", { x, y, ...attributes }, text);
  }

  // A figure of the report that says where it is from.
  figure(x, y, path, options = {}, attributes = {}) {
    const { digits = 1, scale = 1, after = "" } = options;
    const element = this.text(x, y, textOf(valueAt(path) * scale, digits) + after, { class: "value", ...attributes });
    this.set(element, { "data-from": path, "data-digits": digits, "data-scale": scale });
    return element;
  }

  line(x1, y1, x2, y2) {
    this.add("line", { x1, y1, x2, y2, class: "axis" });
  }
}

const REPORT = jsonOf("report");

// `report.thin.least_mm`, as the figures of the text.
function valueAt(path) {
  return path.split(".").slice(1).reduce((value, key) => value?.[key], REPORT);
}

// Round steps of an axis: about `count` up to `most`.
function marks(most, count) {
  const raw = most / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= raw);
  return Array.from({ length: Math.floor(most / step + 1e-9) + 1 }, (_, i) => i * step);
}

const markText = (value) => textOf(value, value % 1 ? 1 : 0);

function iterationsChart(width) {
  const { iterations, best } = REPORT.refinement;
  const chart = new Chart(width, 190, "Error by iteration");
  const values = iterations.map((i) => i.smoothed.mean);
  const most = 1.15 * Math.max(...values);
  const x = (i) => 30 + ((width - 75) * i) / Math.max(iterations.length - 1, 1);
  const y = (v) => 160 - (145 * v) / most;
  for (const mark of marks(most, 4)) {
    chart.line(28, y(mark), width - 40, y(mark));
    chart.text(22, y(mark) + 4, markText(mark), { "text-anchor": "end" });
  }
  chart.add("path", { class: "after", d: values.map((v, i) => `${i ? "L" : "M"}${x(i)} ${y(v)}`).join("") });
  for (const i of new Set([0, iterations.findIndex((it) => it.iteration === best)])) {
    if (i < 0) continue;
    chart.add("circle", { class: "after", cx: x(i), cy: y(values[i]), r: 4 });
    chart.figure(x(i) + 7, y(values[i]) - 7, `report.refinement.iterations.${i}.smoothed.mean`);
  }
  for (const mark of marks(Math.max(iterations.length - 1, 1), 5)) {
    if (mark % 1 === 0) chart.text(x(mark), 180, mark, { "text-anchor": "middle" });
  }
  return chart.svg;
}

function histogramChart(width) {
  const { bin, unrefined, refined } = REPORT.error_histogram;
  const chart = new Chart(width, 190, "Share of the surface by error, before and after refinement");
  const most = 1.05 * Math.max(...unrefined, ...refined);
  const step = (width - 50) / refined.length;
  const y = (v) => 155 - (140 * v) / most;
  for (const mark of marks(100 * most, 4)) {
    chart.line(38, y(mark / 100), width - 10, y(mark / 100));
    chart.text(34, y(mark / 100) + 4, `${markText(mark)} %`, { "text-anchor": "end" });
  }
  refined.forEach((share, i) => chart.add("rect", { class: "after", x: 40 + i * step + 1, width: Math.max(step - 2, 1), y: y(share), height: 155 - y(share) }));
  const outline = unrefined.map((share, i) => `${i ? "L" : "M"}${40 + i * step} ${y(share)}h${step}`);
  chart.add("path", { class: "before", d: outline.join("") });
  const bins = refined.length;
  for (const mark of marks(bins * bin, 5)) {
    const last = mark / bin >= bins - 1;
    if (mark < bins * bin) chart.text(40 + (mark / bin) * step, 173, markText(mark) + (last ? "+" : ""), { "text-anchor": last ? "start" : "middle" });
  }
  return chart.svg;
}

function sharesChart(width) {
  const { shares } = REPORT.evaluation.refined;
  const chart = new Chart(width, 34, "Parts of the error");
  let from = 0;
  for (const [key, name] of [["out_of_gamut", "gamut"], ["too_thin", "thin"], ["cross_talk", "talk"]]) {
    const length = shares[key] * width;
    chart.add("rect", { x: from, y: 2, width: Math.max(length - 1.5, 0), height: 30, rx: 4, style: `fill: var(--${name})` });
    from += length;
  }
  return chart.svg;
}

function classesChart(width) {
  const states = ["unrefined", "refined"].map((state) => REPORT.evaluation[state].colour_classes);
  const rows = states[1].map((after, i) => ({ after, i, j: states[0].findIndex((before) => before.class === after.class) }));
  const narrow = width < 480;
  const [left, row] = narrow ? [0, 52] : [260, 34];
  const chart = new Chart(width, rows.length * row + 4, "Error by class of colour, before and after refinement");
  const most = Math.max(...states.flat().map((c) => c.mean), 1e-9);
  const length = (v) => ((width - left - 44) * v) / most;
  rows.forEach(({ after, i, j }, n) => {
    const top = n * row + (narrow ? 18 : 0);
    const path = `report.evaluation.refined.colour_classes.${i}`;
    const y = n * row + (narrow ? 12 : 19);
    chart.add("rect", { x: 0, y: y - 11, width: 14, height: 14, rx: 3, style: `fill: ${cssOfMean(after.target)}` });
    chart.add("rect", { x: 16, y: y - 11, width: 14, height: 14, rx: 3, style: `fill: ${cssOfMean(after.shown)}` });
    chart.text(38, y, after.class.replaceAll("_", " "), { class: "value" });
    chart.figure(narrow ? width : left - 12, y, `${path}.share`, { digits: 0, scale: 100, after: " % of the surface" }, { "text-anchor": "end", class: "" });
    if (j >= 0) {
      chart.add("rect", { class: "before", x: left, y: top + 4, width: length(states[0][j].mean), height: 10, rx: 2 });
      chart.figure(left + length(states[0][j].mean) + 6, top + 13, `report.evaluation.unrefined.colour_classes.${j}.mean`, {}, { class: "" });
    }
    chart.add("rect", { class: "after", x: left, y: top + 17, width: length(after.mean), height: 10, rx: 2 });
    chart.figure(left + length(after.mean) + 6, top + 26, `${path}.mean`);
  });
  return chart.svg;
}

// Draws every chart that the page has room for, now and whenever its width changes.
function showCharts() {
  const kinds = { iterations: iterationsChart, histogram: histogramChart, shares: sharesChart, classes: classesChart };
  for (const [name, draw] of Object.entries(kinds)) {
    const place = document.getElementById(`chart-${name}`);
    if (!place) continue;
    let width = 0;
    new ResizeObserver(() => {
      if (place.clientWidth === width || !place.clientWidth) return;
      width = place.clientWidth;
      place.replaceChildren(draw(width / unit()));
    }).observe(place);
  }
}
