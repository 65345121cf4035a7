// The wings in space, with the path of the tips and, once flown, the wake they leave.

import { SIGNED, chart, colour, fast } from "./charts.js";
import { card, h } from "./dom.js";
import { flat } from "./flat.js";
import { fixed } from "./format.js";
import { angles, attitude } from "./stroke.js";

/** Steps of the slider where none are flown. */
const STEPS = 60;

/** From stroke-plane axes of the left wing to the earth's, m to mm: x forward, y left, z up. */
function earth([x, y, z], tilt, hinge, side) {
  const [s, c] = [Math.sin(tilt), Math.cos(tilt)];
  return [1000 * (x * c + z * s), 1000 * side * (y + hinge), 1000 * (-x * s + z * c)];
}

const add = (a, u, b, v) => [a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]];

/** Edges of the wing at a phase: rows of corners from leading to trailing edge. */
function plate({ x, sign, wing }, phase, side) {
  const { span, chord } = attitude(angles(x, sign, phase));
  const tilt = (x.stroke_plane_deg * Math.PI) / 180;
  const edge = (which) => wing.stations.map((s) => earth(add(s[0], span, s[which], chord), tilt, wing.hinge_offset_m, side));
  return [edge(1), edge(2)];
}

/** Triangles of a grid of corners, with a number per triangle where the rings have one. */
function surface(rows, values) {
  const columns = rows[0].length;
  const points = rows.flat();
  const mesh = { x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]), i: [], j: [], k: [], intensity: [] };
  for (let r = 0; r + 1 < rows.length; r++) {
    for (let c = 0; c + 1 < columns; c++) {
      const [a, b, d, e] = [r * columns + c, r * columns + c + 1, (r + 1) * columns + c, (r + 1) * columns + c + 1];
      mesh.i.push(a, b); mesh.j.push(b, e); mesh.k.push(d, d);
      if (values) mesh.intensity.push(values[r][c], values[r][c]);
    }
  }
  return mesh;
}

const mirrored = (rows) => rows.map((row) => row.map(([x, y, z]) => [x, -y, z]));
const millimetres = (rows) => rows.map((row) => row.map((p) => p.map((v) => 1000 * v)));

function wingTrace(rows) {
  const { intensity, ...mesh } = surface(rows);
  return { type: "mesh3d", ...mesh, color: colour("c1"), opacity: 1, flatshading: true, hoverinfo: "skip", lighting: { ambient: 0.75, diffuse: 0.5 } };
}

function wakeTrace(rows, values, most, shows) {
  return {
    type: "mesh3d", ...surface(rows, values), intensitymode: "cell", colorscale: SIGNED, cmin: -most, cmax: most, opacity: 0.62,
    flatshading: true, showscale: shows, hoverinfo: "skip", lighting: { ambient: 0.9, diffuse: 0.2 },
    colorbar: { title: { text: "Γ [m²/s]" }, thickness: 10, len: 0.6 },
  };
}

function tips(stroke, side) {
  return Array.from({ length: 121 }, (_, i) => plate(stroke, i / 120, side)[0].at(-1));
}

function pathTrace(path) {
  return {
    type: "scatter3d", mode: "lines", x: path.map((p) => p[0]), y: path.map((p) => p[1]), z: path.map((p) => p[2]),
    line: { color: colour("c2"), width: 4 }, hoverinfo: "skip", showlegend: false,
  };
}

/** Ends of all that will be shown, so that nothing jumps while time goes on. */
function box(stroke) {
  const reach = 1000 * (stroke.wing.wing_length_m + stroke.wing.hinge_offset_m) * 1.02;
  const ends = [[-reach * 0.9, reach * 0.9], [-reach, reach], [-reach * 0.75, reach * 0.75]];
  for (const step of stroke.flight?.wake ?? []) {
    for (const p of step.nodes.flat()) {
      for (const axis of [0, 1, 2]) {
        ends[axis][0] = Math.min(ends[axis][0], 1000 * p[axis], axis === 1 ? -1000 * p[1] : Infinity);
        ends[axis][1] = Math.max(ends[axis][1], 1000 * p[axis], axis === 1 ? -1000 * p[1] : -Infinity);
      }
    }
  }
  return ends;
}

/** What is seen at a time, as corners in mm: wings, wake with its circulations, paths of the tips. */
function seen(stroke, at) {
  const step = stroke.flight?.wake[at];
  const paths = [1, -1].map((side) => tips(stroke, side));
  const hinge = 1000 * stroke.wing.hinge_offset_m;
  if (!step) return { wings: [1, -1].map((side) => plate(stroke, at / STEPS, side)), wakes: [], values: [], most: 1, paths, hinge };
  const rows = millimetres(step.nodes);
  const wing = rows.slice(0, step.wing_rows), wake = rows.slice(step.wing_rows - 1);
  const values = step.circulation_m2_s.slice(step.wing_rows - 1);
  const sizes = values.flat().map(Math.abs).sort((a, b) => a - b);
  const most = sizes[Math.floor(0.97 * (sizes.length - 1))] || 1e-6;
  return { wings: [wing, mirrored(wing)], wakes: wake.length > 1 ? [wake, mirrored(wake)] : [], values, most, paths, hinge };
}

function view(stroke, at, ends) {
  const { wings, wakes, values, most, paths, hinge } = seen(stroke, at);
  const traces = [
    ...wings.map(wingTrace), ...wakes.map((wake, i) => wakeTrace(wake, values, most, i === 0)), ...paths.map(pathTrace),
    { type: "scatter3d", mode: "lines+markers", x: [0, 0], y: [-hinge, hinge], z: [0, 0], marker: { size: 3, color: colour("ink") }, line: { color: colour("ink"), width: 5 }, hoverinfo: "skip", showlegend: false },
  ];
  // A narrow page shows less to the sides: one steps back.
  const away = innerWidth < 640 ? 1.45 : 1;
  const axis = (title, range) => ({ title: { text: title }, range, color: colour("soft"), gridcolor: colour("grid"), zerolinecolor: colour("line"), backgroundcolor: "rgba(0,0,0,0)", nticks: 5 });
  return {
    traces,
    layout: {
      height: 430, margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "keep", showlegend: false,
      scene: {
        xaxis: axis("forward [mm]", ends[0]), yaxis: axis("left [mm]", ends[1]), zaxis: axis("up [mm]", ends[2]),
        aspectmode: "data", uirevision: "keep", camera: { eye: { x: 1.7 * away, y: 1.1 * away, z: 0.75 * away }, center: { x: 0, y: 0, z: -0.1 } },
      },
    },
  };
}

/** The view with its slider over the stroke. */
export function sceneCard(stroke) {
  const plot = chart("");
  const slider = h("input", { type: "range", min: 0, max: STEPS - 1, step: 1, value: 15, id: "time", class: "grow" });
  const said = h("output", { for: "time", class: "small" });
  const play = h("button", { type: "button" }, "Play");
  let ends = null, timer = null;

  const draw = () => {
    const at = slider.valueAsNumber;
    const step = stroke.flight?.wake[at];
    const phase = step ? step.phase : at / STEPS;
    const half = phase < 0.5 ? "downstroke" : "upstroke";
    said.textContent = `${fixed(phase, 2)} strokes, ${half}`;
    slider.setAttribute("aria-valuetext", said.textContent);
    const with_ = step ? `with the wake of stroke ${step.stroke}: colours are circulations of the left wing's rings, the right side is its mirror image` : "and the path of the tips";
    const drawn = fast() ? [() => view(stroke, at, ends), "Drag to turn, scroll or pinch to zoom."] : [() => flat(seen(stroke, at), ends), "Seen from the left and the front, from a little above."];
    plot.show(drawn[0], `The wings ${with_}. ${drawn[1]}`);
  };
  const stop = () => { clearInterval(timer); timer = null; play.textContent = "Play"; };
  play.addEventListener("click", () => {
    if (timer) return stop();
    play.textContent = "Stop";
    timer = setInterval(() => {
      if (!plot.node.isConnected) return stop();
      slider.value = (slider.valueAsNumber + 1) % (Number(slider.max) + 1);
      draw();
    }, stroke.flight?.wake.length ? 140 : 60);
  });
  slider.addEventListener("input", draw);
  const note = fast() ? null : h("p", { class: "hint" }, "This browser has no WebGL: the view is drawn flat and cannot be turned.");
  return {
    root: card("In space", note, plot.figure, h("div", { class: "row" }, play, h("label", { for: "time" }, "Time"), slider, said)),
    update() {
      const steps = stroke.flight?.wake.length || STEPS;
      if (Number(slider.max) !== steps - 1) {
        const share = slider.valueAsNumber / Number(slider.max);
        slider.max = steps - 1;
        slider.value = Math.round(share * (steps - 1));
      }
      ends = box(stroke);
      draw();
    },
  };
}
