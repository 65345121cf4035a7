// The dataset: ten parameters and four means of every sample, or of enough to stand for all.

import { constants, get, take } from "./api.js";
import { SCALE, chart, colour, fast } from "./charts.js";
import { parallelLines } from "./parallel.js";
import { calm, card, h } from "./dom.js";
import { symbol, whole, words } from "./format.js";

const choice = (id, label, options, chosen, changed) => {
  const select = h("select", { id, onchange: changed }, options.map(([value, name]) => h("option", { value, selected: value === chosen }, name)));
  return h("span", { class: "pair" }, h("label", { for: id }, label), select);
};

/** Columns of numbers by name. */
function columns(points, { parameters, outputs }) {
  const all = new Map();
  parameters.forEach((p, i) => all.set(p.name, { title: symbol(p), values: points.parameters.map((x) => x[i]) }));
  outputs.forEach((o, i) => all.set(o.name, { title: o.symbol, values: points.simulated.map((y) => y[i]) }));
  return all;
}

/** The colours' range without the few strokes far out. */
function range(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const at = (share) => sorted[Math.floor(share * (sorted.length - 1))];
  return { cmin: at(0.02), cmax: at(0.98) };
}

function parallel(all, by) {
  const dimensions = [...all.values()].map(({ title, values }) => ({ label: title, values }));
  const { title, values } = all.get(by);
  return {
    traces: [{
      type: "parcoords", dimensions, labelangle: -20, line: { color: values, colorscale: SCALE, showscale: true, colorbar: { title: { text: title }, thickness: 12 }, ...range(values) },
      labelfont: { size: 12, color: colour("ink") }, tickfont: { size: 10, color: colour("ink") }, rangefont: { size: 10, color: colour("soft") },
    }],
    layout: { height: 430, margin: { l: 50, r: 60, t: 70, b: 30 } },
  };
}

function cloud(all, x, y, by, samples) {
  const { title, values } = all.get(by);
  return {
    traces: [{
      x: all.get(x).values, y: all.get(y).values, mode: "markers", text: samples.map((s) => `sample ${s}`),
      marker: { size: 5, opacity: 0.8, color: values, colorscale: SCALE, showscale: true, colorbar: { title: { text: title }, thickness: 12 }, ...range(values) },
      hovertemplate: `%{text}<br>%{x:.4g}, %{y:.4g}, ${title} %{marker.color:.4g}<extra></extra>`,
    }],
    layout: { height: 430, xaxis: { title: all.get(x).title }, yaxis: { title: all.get(y).title } },
  };
}

/** The explorer of a study's samples. */
export function explorerCard(id) {
  const plot = chart("No sample was flown yet.");
  const box = h("div", { class: "scroll" }, plot.figure);
  const controls = h("div", { class: "row" });
  const download = h("p", { class: "small" }, "All samples with all digits: ",
    ["csv", "json", "ndjson"].flatMap((f) => [h("a", { href: `/v1/studies/${id}/dataset?format=${f}`, download: `dataset.${f}`, onclick: take }, f), " "]));
  let points = null, names = null;
  const chosen = () => Object.fromEntries(["kind", "by", "x", "y"].map((k) => [k, controls.querySelector(`#explore-${k}`).value]));
  const draw = () => {
    if (!points?.samples.length) return;
    const all = columns(points, names);
    const { kind, by, x, y } = chosen();
    const wide = kind === "parallel";
    plot.node.style.minWidth = wide ? "58rem" : "0";
    for (const k of ["x", "y"]) controls.querySelector(`#explore-${k}`).disabled = wide;
    const shown = points.samples.length < points.total
      ? `${whole(points.samples.length)} of ${whole(points.total)} samples, evenly thinned by their index` : `all ${whole(points.total)} samples`;
    const told = wide ? `One line per sample across its ten parameters and four means: ${shown}.${fast() ? " Drag along an axis to keep a range, drag a name to move it." : ""}` : `One point per sample: ${shown}.`;
    const coordinates = fast() ? parallel : parallelLines;
    plot.show(() => (wide ? coordinates(all, by, range) : cloud(all, x, y, by, points.samples)), told);
  };
  const load = calm(async () => {
    [points, names] = await Promise.all([get(`/v1/studies/${id}/points`), constants()]);
    if (!controls.firstChild) {
      const means = names.outputs.map((o) => [o.name, `${o.name.replace("_", " ")} ${o.symbol}`]);
      const ten = names.parameters.map((p) => [p.name, `${words(p.name)} ${p.symbol}`]);
      controls.append(choice("explore-kind", "Show", [["parallel", "parallel coordinates"], ["cloud", "two against each other"]], "parallel", draw),
        choice("explore-by", "Colour", [...means, ...ten], "power", draw),
        choice("explore-x", "Across", [...ten, ...means], "frequency_hz", draw),
        choice("explore-y", "Up", [...means, ...ten], "lift", draw));
    }
    draw();
  }, 10000);
  let known = null;
  return {
    root: card("Samples", controls, box, download),
    update(study) {
      if (known === study.samples.succeeded || !study.samples.succeeded) return;
      known = study.samples.succeeded;
      load();
    },
  };
}
