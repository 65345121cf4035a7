// One stroke of the wing: chosen among the optima and the paper's, or set by ten sliders;
// its angles, its path through space, and what it is predicted to do.

import { constants, get } from "./api.js";
import { chart, colour } from "./charts.js";
import { calm, card, h } from "./dom.js";
import { flightCard } from "./flight.js";
import { strokes } from "./optimum.js";
import { predictorCard } from "./predictor.js";
import { sceneCard } from "./scene.js";

const RAD = Math.PI / 180;

/** Sweep, elevation and rotation, rad, at a phase of the stroke in strokes: `numerics/src/kinematics/stroke.rs`. */
export function angles(x, sign, phase) {
  const [s, c] = [Math.sin(2 * Math.PI * phase), Math.cos(2 * Math.PI * phase)];
  const k = Math.min(x.sweep_shape, 0.999);
  const sweep = k < 1e-6 ? -c : -Math.asin(k * c) / Math.asin(k);
  const steep = x.rotation_shape;
  const rotation = steep < 1e-6 ? s : Math.tanh(steep * s) / Math.tanh(steep);
  return [
    RAD * (x.sweep_mean_deg + x.sweep_amplitude_deg * sweep),
    RAD * (x.elevation_mean_deg + sign * x.elevation_amplitude_deg * (c * c - s * s)),
    RAD * (90 + x.rotation_mean_deg - x.rotation_amplitude_deg * rotation),
  ];
}

/** Directions of span and chord in stroke-plane axes: forward, outboard, normal. */
export function attitude([phi, theta, alpha]) {
  const [sp, cp, st, ct, sa, ca] = [Math.sin(phi), Math.cos(phi), Math.sin(theta), Math.cos(theta), Math.sin(alpha), Math.cos(alpha)];
  return { span: [ct * sp, ct * cp, st], chord: [ca * cp - sa * st * sp, -ca * sp - sa * st * cp, sa * ct] };
}

function kinematics(x, sign) {
  const phases = Array.from({ length: 181 }, (_, i) => i / 180);
  const all = phases.map((p) => angles(x, sign, p).map((a) => a / RAD));
  const names = [["sweep φ", "c1", "solid"], ["elevation θ", "c2", "dash"], ["rotation α", "c3", "dot"]];
  return {
    traces: names.map(([name, hue, dash], i) => ({ x: phases, y: all.map((a) => a[i]), name, mode: "lines", line: { color: colour(hue), width: 2, dash } })),
    layout: {
      height: 300, hovermode: "x unified", xaxis: { title: "time, strokes (downstroke, then upstroke)", range: [0, 1] }, yaxis: { title: "degrees" },
      shapes: [{ type: "rect", x0: 0, x1: 0.5, y0: 0, y1: 1, yref: "paper", fillcolor: colour("faint"), line: { width: 0 }, layer: "below" }],
    },
  };
}

/** Strokes one may begin with. */
function presets(study, { cases, parameters }) {
  const own = study.optimisations.flatMap((o) => strokes(o).reverse().map((s) => [`${o.name}, ${s.title}`, s.parameters]));
  const middle = Object.fromEntries(parameters.map((p) => [p.name, (p.lower + p.upper) / 2]));
  return [...own, ...cases.map((c) => [`paper: ${c.title}`, c.parameters]), ["middle of the paper's box", middle]];
}

/** The tab. */
export function strokeTab(id) {
  const root = h("div", {}, h("p", { class: "hint" }, "Loading ..."));
  let begun = false, refresh = () => {};
  const begin = async (study) => {
    const [names, wing] = await Promise.all([constants(), get(`/v1/studies/${id}/wing`)]);
    const sign = wing.elevation_phase === "minus" ? -1 : 1;
    let list = presets(study, names);
    const stroke = { x: { ...list[0][1] }, sign, wing, study, names, flight: null };
    const plot = chart("");
    const scene = sceneCard(stroke);
    const predictor = predictorCard(id, stroke);
    const flight = flightCard(id, stroke, () => scene.update());
    const draw = calm(() => {
      plot.show(() => kinematics(stroke.x, sign), `The three angles over one stroke of ${(1000 / stroke.x.frequency_hz).toFixed(1)} ms; the shaded half is the downstroke.`);
      scene.update();
    }, 60);
    const changed = () => { stroke.flight = null; flight.update(); draw(); };
    const choose = h("select", { id: "preset", onchange: () => { Object.assign(stroke.x, list[choose.selectedIndex][1]); predictor.show(); changed(); } });
    const offer = () => {
      const at = Math.max(0, choose.selectedIndex);
      choose.replaceChildren(...list.map(([name]) => h("option", {}, name)));
      choose.selectedIndex = at;
    };
    offer();
    predictor.onchange = changed;
    root.replaceChildren(
      h("div", { class: "row card" }, h("label", { for: "preset" }, "Begin with"), choose),
      h("div", { class: "grid" }, predictor.root, scene.root, card("Angles", plot.figure), flight.root));
    predictor.show();
    changed();
    refresh = (fresh) => { stroke.study = fresh; list = presets(fresh, names); if (list.length !== choose.length) offer(); predictor.update(); };
  };
  return {
    root,
    update(study) {
      if (begun) return refresh(study);
      begun = true;
      begin(study).catch((error) => { begun = false; root.replaceChildren(h("p", { class: "fault" }, error.message)); });
    },
  };
}
