// Parallel coordinates for browsers without WebGL: the same lines, which cannot be brushed.

import { SCALE, colour } from "./charts.js";

/** Most lines: each is a piece of SVG. */
const MOST = 500;
/** Lines of one colour are one trace: Viridis in steps. */
const HUES = ["#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"];

const short = (value) => String(Number(value.toPrecision(3)));

/** Lines over columns of numbers by name, coloured by one of them within the ends `range` gives. */
export function parallelLines(all, by, range) {
  const columns = [...all.values()].map(({ title, values }) => {
    const low = Math.min(...values), high = Math.max(...values);
    return { title, values, low, high, at: (i) => (high > low ? (values[i] - low) / (high - low) : 0.5) };
  });
  const { title, values } = all.get(by);
  const { cmin, cmax } = range(values);
  const step = Math.max(1, Math.ceil(values.length / MOST));
  const lines = HUES.map((hue) => ({ x: [], y: [], mode: "lines", line: { color: hue, width: 1 }, opacity: 0.6, hoverinfo: "skip", showlegend: false }));
  for (let i = 0; i < values.length; i += step) {
    const share = cmax > cmin ? (values[i] - cmin) / (cmax - cmin) : 0.5;
    const of = lines[Math.max(0, Math.min(HUES.length - 1, Math.floor(share * HUES.length)))];
    columns.forEach((column, k) => { of.x.push(k); of.y.push(column.at(i)); });
    of.x.push(null);
    of.y.push(null);
  }
  const bar = {
    x: [0], y: [0], mode: "markers", hoverinfo: "skip", showlegend: false,
    marker: { size: 0.1, opacity: 0, color: [cmin], cmin, cmax, colorscale: SCALE, showscale: true, colorbar: { title: { text: title }, thickness: 12 } },
  };
  const note = (k, y, yanchor, text) => ({ x: k, y, yanchor, text, showarrow: false, font: { size: 10, color: colour("soft") } });
  return {
    traces: [...lines.filter((line) => line.x.length), bar],
    layout: {
      height: 430, margin: { l: 20, r: 60, t: 30, b: 70 },
      annotations: columns.flatMap((column, k) => [note(k, 1.01, "bottom", short(column.high)), note(k, -0.01, "top", short(column.low))]),
      shapes: columns.map((_, k) => ({ type: "line", x0: k, x1: k, y0: 0, y1: 1, line: { color: colour("soft"), width: 1 }, layer: "above" })),
      xaxis: { range: [-0.4, columns.length - 0.6], tickvals: columns.map((_, k) => k), ticktext: columns.map((column) => column.title), tickangle: -30, showgrid: false, zeroline: false, fixedrange: true },
      yaxis: { range: [-0.08, 1.08], visible: false, fixedrange: true },
    },
  };
}
