// How searches converge: generations, and the strokes flown around an optimum.

import { chart, colour } from "./charts.js";
import { h } from "./dom.js";
import { digits } from "./format.js";

const line = (x, y, name, hue, more = {}) => ({ x, y, name, mode: "lines+markers", marker: { size: 4 }, line: { color: colour(hue), width: 2 }, ...more });

function refining(history) {
  const n = history.map((_, i) => i + 1);
  return {
    traces: [
      line(n, history.map((e) => e[0]), "|1−L+| + |D+| + |M+|", "c2"),
      line(n, history.map((e) => e[1]), "P+ (right)", "c1", { yaxis: "y2" }),
    ],
    layout: {
      height: 260, hovermode: "x unified", xaxis: { title: "strokes flown" }, margin: { l: 55, r: 50, t: 12, b: 38 },
      yaxis: { title: "out of trim", type: "log", exponentformat: "power" }, yaxis2: { title: "P+", overlaying: "y", side: "right", showgrid: false, tickmode: "auto", nticks: 5 },
    },
  };
}

function generations(best, mean) {
  const n = best.map((_, i) => i);
  return {
    traces: [line(n, best, "best", "c1"), line(n, mean, "mean", "c2")],
    layout: { height: 260, hovermode: "x unified", xaxis: { title: "generation" }, yaxis: { title: "fitness", type: "log" } },
  };
}

/** The plots of one optimisation's searches; shown once they are on the page. */
export function searchPlots(optimisation) {
  const parts = [];
  const bred = optimisation.breeding?.standing.history ?? optimisation.optimum?.history.map((g) => [g.best, g.mean]) ?? [];
  if (bred.length > 1) {
    const plot = chart("");
    const told = `${bred.length} generations, best fitness ${digits(bred.at(-1)[0], 5)}.`;
    parts.push(["Generations", plot, () => plot.show(() => generations(bred.map((g) => g[0]), bred.map((g) => g[1])), told)]);
  }
  const refined = optimisation.search?.standing.history ?? [];
  if (refined.length > 1) {
    const plot = chart("");
    const [trim, power] = refined.at(-1);
    const told = `The best stroke after each one flown: at last out of trim by ${digits(trim)}, with P+ ${digits(power, 5)}.`;
    parts.push(["Refining", plot, () => plot.show(() => refining(refined), told)]);
  }
  return {
    root: h("div", { class: "grid" }, parts.map(([title, plot]) => h("div", {}, h("h3", {}, title), plot.figure))),
    show: () => parts.forEach(([, , show]) => show()),
  };
}
