// The view in space for browsers without WebGL: the same corners, drawn flat from one side.

import { SIGNED, colour } from "./charts.js";

/** From where it is seen, as the view in space begins: x forward, y left, z up. */
const EYE = [1.7, 1.1, 0.75];

const long = (v) => Math.hypot(...v);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const right = [-EYE[1], EYE[0], 0].map((v) => v / Math.hypot(EYE[0], EYE[1]));
const away = EYE.map((v) => v / long(EYE));
const up = [away[1] * right[2] - away[2] * right[1], away[2] * right[0] - away[0] * right[2], away[0] * right[1] - away[1] * right[0]];

const project = (points) => ({ x: points.map((p) => dot(p, right)), y: points.map((p) => dot(p, up)) });

/** Around a grid of corners, from the leading edge back along the trailing one. */
function outline(rows) {
  const sides = (end) => rows.map((row) => row.at(end));
  return [...rows[0], ...sides(-1), ...rows.at(-1).toReversed(), ...sides(0).toReversed()];
}

/** The middle of each cell of a grid of corners. */
function middles(rows) {
  const points = [];
  for (let r = 0; r + 1 < rows.length; r++) {
    for (let c = 0; c + 1 < rows[r].length; c++) {
      const corners = [rows[r][c], rows[r][c + 1], rows[r + 1][c], rows[r + 1][c + 1]];
      points.push([0, 1, 2].map((k) => corners.reduce((sum, p) => sum + p[k], 0) / 4));
    }
  }
  return points;
}

/** Traces and layout of what is seen; `ends` are those of all that will be, so that nothing jumps. */
export function flat({ wings, wakes, values, most, paths, hinge }, ends) {
  const bare = { hoverinfo: "skip", showlegend: false };
  const rings = values.flat();
  const traces = wakes.map((wake, i) => ({
    ...project(middles(wake)), ...bare, mode: "markers",
    marker: { size: 4, opacity: 0.6, color: rings, colorscale: SIGNED, cmin: -most, cmax: most, showscale: i === 0, colorbar: { title: { text: "Γ [m²/s]" }, thickness: 10, len: 0.6 } },
  }));
  traces.push(
    ...wings.map((rows) => ({ ...project(outline(rows)), ...bare, mode: "lines", fill: "toself", fillcolor: colour("c1"), opacity: 0.75, line: { color: colour("c1"), width: 1 } })),
    ...paths.map((path) => ({ ...project(path), ...bare, mode: "lines", line: { color: colour("c2"), width: 2 } })),
    { ...project([[0, -hinge, 0], [0, hinge, 0]]), ...bare, mode: "lines+markers", marker: { size: 4, color: colour("ink") }, line: { color: colour("ink"), width: 3 } });
  const corners = project([0, 1].flatMap((i) => [0, 1].flatMap((j) => [0, 1].map((k) => [ends[0][i], ends[1][j], ends[2][k]]))));
  const axis = (values, more = {}) => ({ range: [Math.min(...values), Math.max(...values)], visible: false, ...more });
  return {
    traces,
    layout: { height: 430, margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, xaxis: axis(corners.x), yaxis: axis(corners.y, { scaleanchor: "x" }) },
  };
}
