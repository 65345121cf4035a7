// The answer: each optimum beside the paper's, predicted beside simulated, and what it is worth.

import { constants } from "./api.js";
import { badge, calm, card, h, table } from "./dom.js";
import { digits, estimate, fixed, symbol, whole, words } from "./format.js";
import { searchPlots } from "./search.js";

/** P0 of the paper's hawkmoth, mW: what its powers are divided by here. */
const PAPER_P0_MW = 84.2;

/** The published stroke which answers the same question, as the coordinator says; null where there is none. */
export function published(optimisation, cases) {
  return cases.find((c) => c.name === optimisation.paper) ?? null;
}

/** The strokes of an optimisation: what was found, and what refining made of it. */
export function strokes(optimisation) {
  const found = optimisation.optimum;
  const standing = optimisation.search?.standing;
  const list = [];
  if (found) {
    list.push({
      title: optimisation.breeding ? "generations'" : "surrogate's", parameters: found.parameters, predicted: found.predicted,
      simulated: optimisation.simulated?.scaled, perLift: optimisation.simulated?.power_per_lift_w_per_n,
    });
  }
  if (standing?.best) {
    list.push({
      title: "refined", parameters: standing.best.parameters, predicted: standing.predicted,
      simulated: standing.best.scaled, perLift: standing.power_per_lift_w_per_n,
    });
  }
  return list;
}

function parametersTable(columns, paper, parameters) {
  return table(null, [
    ["Parameter", (p) => `${words(p.name)} ${symbol(p)}`],
    ...columns.map((c) => [c.title, (p) => fixed(c.parameters[p.name], 3), true]),
    ...(paper ? [["paper", (p) => digits(paper.parameters[p.name], 4), true]] : []),
  ], parameters);
}

function meansTable(columns, paper, outputs) {
  const theirs = paper ? [paper.lift, 0, 0, paper.power_mw === null ? null : paper.power_mw / PAPER_P0_MW] : [];
  const rows = outputs.map((o, i) => ({ name: `${o.name.replace("_", " ")} ${o.symbol}`, of: o.name, paper: fixed(theirs[i], 3) }));
  rows.push({ name: "P/L [W/N]", paper: paper && fixed(paper.power_per_lift_w_per_n, 2) });
  return table(null, [
    ["Mean", (r) => r.name],
    ...columns.flatMap((c) => [
      [`${c.title}: predicted`, (r) => (r.of ? fixed(c.predicted?.[r.of], 4) : "-"), true],
      ["simulated ± se", (r) => (r.of ? estimate(c.simulated?.[r.of]) : fixed(c.perLift, 3)), true],
    ]),
    ...(paper ? [["paper", (r) => r.paper, true]] : []),
  ], rows, true);
}

/** What there is to say beside the tables. */
function remarks(o) {
  const said = (o.warnings ?? []).map((warning) => `Warning: ${warning}.`);
  const search = o.search;
  const of = o.breeding ? "Generations' optimum" : "Surrogate's optimum";
  const room = (mm) => (mm < 0 ? `the wings cross the plane of symmetry by ${fixed(-mm, 2)} mm.` : `the wings keep ${fixed(mm, 2)} mm from the plane of symmetry.`);
  if (o.breeding) said.push(`${o.breeding.standing.rounds} generations, ${whole(o.breeding.standing.simulations)} strokes flown: ${o.breeding.ended ?? "they go on"}.`);
  if (search) {
    const { rounds, simulations, trimmed_power: power, prices } = search.standing;
    said.push(`Refined by ${whole(simulations)} simulations in ${rounds} round${rounds === 1 ? "" : "s"}: ${search.ended ?? "it goes on"}.`);
    if (power && prices) said.push(`Refined optimum: P+ in exact trim ${fixed(power, 4)}: it rises by ${fixed(prices.lift, 3)} per unit of L+, ${fixed(prices.drag, 3)} of D+, ${fixed(prices.pitch_moment, 3)} of M+.`);
  }
  if (o.simulated?.outcome === "infeasible") said.push(`The optimum cannot be flown: ${o.simulated.reason}.`);
  if (o.optimum) said.push(`${of}: ${room(o.optimum.clearance_mm)}`);
  if (typeof o.refined_clearance_mm === "number") said.push(`Refined optimum: ${room(o.refined_clearance_mm)}`);
  const known = o.optimum?.optimality;
  if (known) {
    said.push(`${of}: ${known.converged} of ${known.starts} descents converged, to ${known.optima.length} ${known.optima.length === 1 ? "optimum" : "optima"}; ` +
      `KKT residual ${known.kkt_residual.toExponential(1)}, violation ${known.violation.toExponential(1)}.`);
  }
  return h("ul", { class: "small" }, said.map((line) => h("li", {}, line)));
}

/** Where the descents ended: how many, with what power, and the strokes. */
function localOptima(known, parameters) {
  if (!known || known.optima.length < 2) return null;
  const rows = known.optima.map((o, i) => ({ ...o, number: i + 1 }));
  return h("details", {}, h("summary", {}, `All ${rows.length} local optima of the surrogate`), table(null, [
    ["Optimum", (o) => o.number],
    ["P+", (o) => fixed(o.predicted.power, 4), true],
    ["descents", (o) => whole(o.hits), true],
    ...parameters.map((p) => [symbol(p), (o) => fixed(o.parameters[p.name], 2), true]),
    ["clearance [mm]", (o) => fixed(o.clearance_mm, 2), true],
  ], rows, true));
}

/** All optimisations of a study. */
export function optimaTab(id) {
  const root = h("div", {}, h("p", { class: "hint" }, "No optimum was found yet."));
  let known = "", plots = [];
  const show = async (study) => {
    const { cases, parameters, outputs } = await constants();
    plots = [];
    const cards = study.optimisations.map((o) => {
      const columns = strokes(o);
      const paper = published(o, cases);
      if (columns.length === 0 && !o.breeding) return card(o.name, h("p", {}, badge(o.status)));
      const convergence = searchPlots(o);
      plots.push(convergence);
      return card(paper ? `${o.name} beside ${paper.title}` : o.name, h("p", {}, badge(o.status), " ", h("a", { href: `#/studies/${id}/stroke` }, "look at the stroke")),
        columns.length ? h("div", { class: "answer" }, meansTable(columns, paper, outputs),
          h("div", { class: "grid" }, parametersTable(columns, paper, parameters), remarks(o)),
          localOptima(o.optimum?.optimality, parameters)) : null,
        convergence.root);
    });
    root.replaceChildren(...cards);
    for (const plot of plots) plot.show();
  };
  let latest = null;
  const later = calm(() => show(latest), 1500);
  return {
    root,
    update(study) {
      latest = study;
      const state = JSON.stringify(study.optimisations);
      if (state === known || study.optimisations.length === 0) return;
      known = state;
      later();
    },
  };
}
