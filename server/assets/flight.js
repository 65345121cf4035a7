// The chosen stroke flown by the solver itself: loads and power over the stroke, and the wake.

import { offers, post } from "./api.js";
import { chart, colour } from "./charts.js";
import { card, fill, h, table } from "./dom.js";
import { digits, estimate } from "./format.js";

const ROUTE = "/v1/simulations";

const trace = (x, y, name, hue, more = {}) => ({ x, y, name, mode: "lines", line: { color: colour(hue), width: 2, ...more } });

function shaded() {
  return [{ type: "rect", x0: 0, x1: 0.5, y0: 0, y1: 1, yref: "paper", fillcolor: colour("faint"), line: { width: 0 }, layer: "below" }];
}

function loads(rows, scales) {
  const x = rows.map((r) => r.phase);
  const of = (name, scale) => rows.map((r) => r[name] / scale);
  return {
    traces: [
      trace(x, of("lift_n", scales.lift), "lift / W", "c1"),
      trace(x, of("drag_n", scales.drag), "drag / W", "c2", { dash: "dash" }),
      trace(x, of("pitch_moment_nm", scales.pitch_moment), "moment / W c", "c3", { dash: "dot" }),
    ],
    layout: { height: 300, hovermode: "x unified", shapes: shaded(), xaxis: { title: "time, strokes", range: [0, 1] }, yaxis: { title: "scaled" } },
  };
}

function power(rows) {
  const x = rows.map((r) => r.phase);
  const of = (name) => rows.map((r) => 1000 * r[name]);
  return {
    traces: [
      trace(x, of("power_w"), "power", "c1"), trace(x, of("sweep_required_w"), "of sweep", "c2", { dash: "dash" }),
      trace(x, of("elevation_required_w"), "of elevation", "c3", { dash: "dot" }), trace(x, of("rotation_required_w"), "of rotation", "c4", { dash: "dashdot" }),
    ],
    layout: { height: 300, hovermode: "x unified", shapes: shaded(), xaxis: { title: "time, strokes", range: [0, 1] }, yaxis: { title: "mW" } },
  };
}

/** The card; `flown` is called once the stroke has a flight. */
export function flightCard(id, stroke, flown) {
  const said = h("div", { "aria-live": "polite" });
  const [first, second] = [chart(""), chart("")];
  const plots = h("div", { hidden: true }, first.figure, second.figure);
  const button = h("button", { type: "button", class: "main", onclick: () => fly() }, "Fly this stroke");
  let asked = 0;

  const show = (flight) => {
    const { scales } = stroke.wing;
    if (flight.outcome === "infeasible") {
      fill(said, h("p", { class: "fault" }, `This stroke cannot be flown: ${flight.reason}.`));
      return;
    }
    const rows = flight.history;
    const means = stroke.names.outputs.map((o) => [`${o.name.replace("_", " ")} ${o.symbol}`, estimate(flight.scaled[o.name])]);
    means.push(["P/L [W/N]", digits(flight.power_per_lift_w_per_n, 4)]);
    fill(said, table(`Means over ${flight.strokes_averaged} strokes, solver ${flight.solver_version}`,
      [["Mean", (m) => m[0]], ["simulated ± se", (m) => m[1], true]], means));
    plots.hidden = false;
    const peak = Math.max(...rows.map((r) => r.lift_n)) / scales.lift;
    first.show(() => loads(rows, scales), `Loads of both wings over the last stroke flown; lift reaches ${digits(peak)} times the weight.`);
    second.show(() => power(rows), `Power the muscles must deliver, and its parts by joint; at most ${digits(1000 * Math.max(...rows.map((r) => r.power_w)))} mW.`);
  };

  const fly = async () => {
    const mine = ++asked;
    button.disabled = true;
    fill(said, h("p", { class: "hint" }, "Flying ..."));
    try {
      const wake = stroke.study.spec.model.kind === "uvlm" ? "stroke" : null;
      const flight = await post(ROUTE, { study: id, parameters: stroke.x, wake });
      if (mine === asked) {
        stroke.flight = flight;
        show(flight);
        flown();
      }
    } catch (error) {
      if (mine === asked) {
        const faults = (error.problem?.errors ?? []).map((f) => `${f.pointer}: ${f.detail}`);
        fill(said, h("p", { class: "fault" }, [error.message, ...faults].join("; ")));
      }
    }
    button.disabled = false;
  };

  offers(ROUTE).then((there) => {
    if (there) return;
    button.hidden = true;
    fill(said, h("p", { class: "hint" }, "This coordinator does not fly single strokes; ", h("code", {}, "manduca simulate --history"), " does."));
  });
  return {
    root: card("Flown step by step", h("p", { class: "soft small" }, "Lift, drag, moment and power as the solver finds them for the stroke chosen, with the wake above."), button, said, plots),
    /** The stroke is another: what was flown is not of it. */
    update() {
      asked += 1;
      button.disabled = false;
      plots.hidden = true;
      if (!button.hidden) fill(said);
    },
  };
}
