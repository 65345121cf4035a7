// What a bound on one parameter costs: the least power in trim under limits of it.

import { constants, get } from "./api.js";
import { chart, colour } from "./charts.js";
import { card, fill, h } from "./dom.js";
import { fixed, symbol, words } from "./format.js";

/** Limits of a front. */
const POINTS = 9;

/** The front of a study's surrogate, drawn when it is asked for: a second or so of the coordinator's time. */
export function frontCard(id) {
  const plot = chart("Not computed yet.");
  const quantity = h("select", { id: "front-quantity" });
  const within = h("select", { id: "front-within" });
  const said = h("p", { class: "hint" }, "The least power when a parameter must stay below, or above, each of some limits, by the surrogate; nothing is flown.");
  const ask = h("button", { class: "main", onclick: () => draw() }, "Compute");
  const row = h("div", { class: "row" }, h("label", { for: "front-quantity" }, "Power against "), quantity,
    h("label", { for: "front-within" }, " within "), within, ask);
  const root = card("Front of power", said, row, plot.figure);

  const draw = async () => {
    ask.disabled = true;
    fill(said, "Computing ...");
    try {
      const { parameters } = await constants();
      const more = within.value ? `&optimisation=${encodeURIComponent(within.value)}` : "";
      const front = await get(`/v1/studies/${id}/surrogate/front?quantity=${quantity.value}&points=${POINTS}${more}`);
      show(front, parameters.find((p) => p.name === front.quantity));
    } catch (error) {
      fill(said, h("span", { class: "fault" }, error.message));
    }
    ask.disabled = false;
  };
  const show = (front, parameter) => {
    if (front.free === null) {
      fill(said, "The surrogate knows no stroke in trim within these bounds.");
      return;
    }
    const there = front.points.filter((p) => p.power !== null);
    const missing = front.points.length - there.length;
    fill(said, `Free, ${words(parameter.name)} is ${fixed(front.free, 2)} ${parameter.unit} with P+ = ${fixed(front.least_power, 4)}.`,
      missing ? ` Under ${missing} limits no stroke in trim is known.` : "",
      ` By the surrogate as it was trained, before refining${front.test_rmse ? `; its test error (rms) of P+ is ${fixed(front.test_rmse.power, 4)}` : ""}.`);
    const of = (side) => there.filter((p) => p.side === side);
    const trace = (name, points, dash) => ({
      name, x: points.map((p) => p.limit), y: points.map((p) => p.power), mode: "lines+markers", line: { dash },
      hovertemplate: "limit %{x:.2f}<br>P+ %{y:.4f}<extra></extra>",
    });
    plot.show(() => ({
      traces: [
        trace("at most the limit", of("at-most"), "solid"), trace("at least the limit", of("at-least"), "dash"),
        { name: "optimum", x: [front.free], y: [front.least_power], mode: "markers", marker: { symbol: "star", size: 12, color: colour("ink") } },
      ],
      layout: { xaxis: { title: `limit of ${symbol(parameter)}` }, yaxis: { title: "least power P+" } },
    }), `Least power P+ against limits of ${words(parameter.name)}: ${there.map((p) => `${fixed(p.power, 3)} at ${fixed(p.limit, 1)}`).join(", ")}.`);
  };
  return {
    root,
    /** Offers what may be asked once there is a surrogate. */
    async update(study) {
      root.hidden = !study.surrogate;
      if (root.hidden || quantity.options.length) return;
      const { parameters } = await constants();
      if (quantity.options.length) return;
      const free = parameters.filter((p) => Array.isArray(study.spec.parameters[p.name]) || study.spec.parameters[p.name] === undefined);
      quantity.append(...free.map((p) => h("option", { value: p.name, selected: p.name === "stroke_plane_deg" }, words(p.name))));
      within.append(h("option", { value: "" }, "the whole box"), ...study.spec.optimisations.map((o) => h("option", { value: o.name }, o.name)));
    },
  };
}
