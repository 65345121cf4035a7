// The surrogate: how its training goes, and how far its predictions are from simulations.

import { constants, get } from "./api.js";
import { chart, colour } from "./charts.js";
import { calm, card, fill, h, table } from "./dom.js";
import { digits, fixed, whole } from "./format.js";

const MOMENTS = [["train_mse", "training", "c1"], ["validation_mse", "validation", "c2"], ["test_mse", "test", "c3"]];

/** Whether a study has, or may have, something to tell of its surrogate. */
function trains(study) {
  const state = study.state === "paused" ? study.paused_from : study.state;
  return study.surrogate || (state === "training" && study.progress);
}

function lines(curve) {
  const networks = [...new Set(curve.map((e) => e.network))];
  return networks.flatMap((network, k) => MOMENTS.map(([field, name, hue]) => {
    const of = curve.filter((e) => e.network === network);
    return {
      x: of.map((e) => e.iteration), y: of.map((e) => e[field]), name, mode: "lines", legendgroup: name, showlegend: k === 0,
      line: { color: colour(hue), width: 2, dash: name === "training" ? "solid" : name === "validation" ? "dash" : "dot" },
      hovertemplate: `network ${network + 1}, ${name} %{y:.3g}<extra></extra>`,
    };
  }));
}

/** The training curve, live while it trains. */
export function curveCard(id) {
  const plot = chart("The training has not begun.");
  const text = h("div", {});
  const load = calm(async () => {
    let view;
    try {
      view = await get(`/v1/studies/${id}/surrogate`);
    } catch (error) {
      if (error.status === 404) return;
      throw error;
    }
    if (view.kind === "gaussian-process") {
      plot.figure.hidden = true;
      fill(text, h("p", {}, `A gaussian process: no curve. ${view.stops.join("; ")}.`));
      return;
    }
    const last = view.curve.at(-1);
    const networks = 1 + (last?.network ?? 0);
    const told = last ? `${networks > 1 ? `${networks} networks` : "One network"} of ${view.neurons} neurons, iteration ${last.iteration}: ` +
      `mean squared errors ${digits(last.train_mse)} training, ${digits(last.validation_mse)} validation, ${digits(last.test_mse)} test.` : "";
    plot.show(() => ({
      traces: lines(view.curve),
      layout: { height: 330, hovermode: "x unified", xaxis: { title: "iteration" }, yaxis: { title: "mean squared error", type: "log", exponentformat: "power" } },
    }), told);
    fill(text, view.stops.length ? h("p", { class: "small soft" }, view.stops.map((stop, i) => `Network ${i + 1} is from iteration ${view.best_iterations[i]}: ${stop}. `)) : null);
  }, 1500);
  let done = false;
  return {
    root: card("Training curve", plot.figure, text),
    update(study) {
      if (done || !trains(study)) return;
      done = Boolean(study.surrogate);
      load();
    },
  };
}

/** One plot per output, predictions over simulations. */
function pairs(points, outputs) {
  const hues = ["c1", "c2", "c3", "c4"];
  const layout = { height: 560, showlegend: false, margin: { l: 50, r: 10, t: 24, b: 40 }, annotations: [], grid: undefined };
  const traces = [];
  outputs.forEach((output, i) => {
    const [x, y] = [points.simulated.map((s) => s[i]), points.predicted.map((p) => p[i])];
    const all = x.concat(y);
    const ends = [Math.min(...all), Math.max(...all)];
    const n = i ? i + 1 : "";
    const columns = [[0, 0.44], [0.56, 1]], rows = [[0.57, 1], [0, 0.43]];
    layout[`xaxis${n}`] = { domain: columns[i % 2], anchor: `y${n}`, title: `${output.symbol} simulated` };
    layout[`yaxis${n}`] = { domain: rows[i >> 1], anchor: `x${n}`, title: "predicted" };
    const at = { xaxis: `x${n}`, yaxis: `y${n}` };
    traces.push({ ...at, x: ends, y: ends, mode: "lines", line: { color: colour("soft"), width: 1, dash: "dash" }, hoverinfo: "skip" });
    traces.push({
      ...at, x, y, mode: "markers", marker: { size: 4, opacity: 0.65, color: colour(hues[i]) },
      text: points.samples.map((s) => `sample ${s}`), hovertemplate: "%{text}<br>simulated %{x:.4g}<br>predicted %{y:.4g}<extra></extra>",
    });
  });
  return { traces, layout };
}

/** Errors by output and share. */
function errors(view, outputs) {
  const shares = [["train", "training"], ["validation", "validation"], ["test", "test"]].filter(([share]) => view[share]);
  const counts = shares.map(([share, name]) => `${whole(view[share].count)} ${name}`).join(", ");
  return table(`Root mean square errors of the scaled means, and correlation on the test share; samples: ${counts}`, [
    ["Mean", (o) => o.symbol],
    ...shares.map(([share, name]) => [name, (o) => digits(view[share].rmse[o.name], 3), true]),
    ["correlation", (o) => fixed(view.test?.correlation[o.name], 4), true],
  ], outputs);
}

/** Predictions against simulations on the test share. */
export function errorsCard(id) {
  const plot = chart("There is no surrogate yet.");
  const share = h("select", { id: "share", onchange: () => load() },
    ["test", "validation", "train"].map((name) => h("option", { value: name }, name === "train" ? "training" : name)));
  const text = h("div", {});
  const load = calm(async () => {
    const [{ outputs }, points, view] = await Promise.all([
      constants(), get(`/v1/studies/${id}/points?share=${share.value}`), get(`/v1/studies/${id}/surrogate`),
    ]);
    if (!points.predicted) return;
    const shown = points.samples.length < points.total ? `${whole(points.samples.length)} of ${whole(points.total)}` : `all ${whole(points.total)}`;
    plot.show(() => pairs(points, outputs), `Predicted over simulated: ${shown} samples of this share. On the dashed line both agree.`);
    fill(text, errors(view, outputs));
  }, 1500);
  let done = false;
  return {
    root: card("Predicted against simulated", h("div", { class: "row" }, h("label", { for: "share" }, "Share"), share), plot.figure, text),
    update(study) {
      if (done || !study.surrogate) return;
      done = true;
      load();
    },
  };
}
