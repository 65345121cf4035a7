// Ten sliders, answered by the surrogate at once.

import { post } from "./api.js";
import { card, fill, h } from "./dom.js";
import { digits, fixed, symbol, words } from "./format.js";
import { angles, attitude } from "./stroke.js";

/** As many digits as a box shows; what differs from zero by rounding is zero. */
const short = (value) => Number(value.toFixed(Math.abs(value) < 10 ? 3 : 2));

/** Bounds of a parameter in a study: its own, or the paper's. */
function bounds(spec, parameter) {
  const own = spec.parameters[parameter.name];
  if (Array.isArray(own)) return own;
  return [parameter.lower, parameter.upper];
}

/** Least distance of the wings from the plane of symmetry over a stroke, m. */
function clearance({ x, sign, wing }) {
  let least = Infinity;
  for (let i = 0; i < 96; i++) {
    const { span, chord } = attitude(angles(x, sign, i / 96));
    for (const [along, leading, trailing] of wing.stations) {
      least = Math.min(least, along * span[1] + leading * chord[1], along * span[1] + trailing * chord[1]);
    }
  }
  return least + wing.hinge_offset_m;
}

/** The sliders and what is predicted; `onchange` is called when one moved. */
export function predictorCard(id, stroke) {
  const { parameters, outputs } = stroke.names;
  const answer = h("div", { "aria-live": "polite" });
  const panel = { onchange: () => {} };
  let waiting = false, again = false;

  const predict = async () => {
    if (waiting) { again = true; return; }
    waiting = true;
    do {
      again = false;
      await show();
    } while (again);
    waiting = false;
  };
  const show = async () => {
    const gap = clearance(stroke) * 1000;
    const warning = h("p", { class: "small soft" }, gap < 0 ? `The wings would cross the plane of symmetry by ${fixed(-gap, 1)} mm: this stroke cannot be flown.`
      : `The wings keep ${fixed(gap, 1)} mm from the plane of symmetry.`);
    if (!stroke.study.surrogate) {
      fill(answer, h("p", { class: "hint" }, "There is no surrogate yet to predict with."), warning);
      return;
    }
    try {
      const { predictions: [p], test_rmse: rmse, outside } = await post(`/v1/studies/${id}/surrogate/predictions`, { points: [stroke.x] });
      const { scales } = stroke.wing;
      const perLift = p.lift > 0 ? (p.power * scales.power) / (p.lift * scales.lift) : null;
      const facts = outputs.map((o) => [o.symbol, fixed(p[o.name], 4)]);
      facts.push(["P/L [W/N]", digits(perLift, 4)]);
      // Refining does not teach the surrogate: at a refined optimum the simulated numbers are the better ones.
      const worth = rmse ? ` Test errors (rms): ${outputs.map((o) => `${o.symbol} ${fixed(rmse[o.name], 4)}`).join(", ")}.` : "";
      const label = h("p", { class: "small soft" }, `By the surrogate as it was trained, before refining.${worth}`,
        outside?.length ? ` Outside the study's box (${outside[0].parameters.map(words).join(", ")}): nothing was learnt there.` : "");
      fill(answer, h("dl", { class: "facts" }, facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value)))), label, warning);
    } catch (error) {
      const faults = error.problem?.errors ?? [];
      fill(answer, h("p", { class: "fault" }, faults.length ? faults.map((f) => `${f.pointer}: ${f.detail}`).join("; ") : error.message));
    }
  };

  const rows = parameters.map((p) => {
    const [low, high] = bounds(stroke.study.spec, p);
    const range = h("input", { type: "range", id: `p-${p.name}`, min: low, max: high, step: "any", "aria-label": `${words(p.name)}: ${p.meaning}` });
    const number = h("input", { type: "number", step: "any", "aria-label": `${words(p.name)}, value` });
    const set = (value, from) => {
      if (!Number.isFinite(value)) return;
      stroke.x[p.name] = value;
      if (from !== number) number.value = short(value);
      if (from !== range) range.value = value;
      panel.onchange();
      predict();
    };
    range.addEventListener("input", () => set(range.valueAsNumber, range));
    number.addEventListener("input", () => set(number.valueAsNumber, number));
    const label = h("label", { for: `p-${p.name}`, title: p.meaning }, `${words(p.name)} ${symbol(p)}`);
    return { p, range, number, nodes: [label, range, number] };
  });

  return Object.assign(panel, {
    root: card("Predictor", answer, h("div", { class: "sliders" }, rows.map((row) => row.nodes))),
    /** Shows a stroke that was chosen elsewhere; the sliders widen where it lies outside. */
    show() {
      for (const { p, range, number } of rows) {
        const value = stroke.x[p.name];
        const [low, high] = bounds(stroke.study.spec, p);
        range.min = Math.min(low, value);
        range.max = Math.max(high, value);
        range.value = value;
        number.value = short(value);
      }
      predict();
    },
    update: predict,
  });
}
