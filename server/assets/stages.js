// Where a study is: the rail of its stages, how far the present one is, and when it will be done.

import { badge, fill, h } from "./dom.js";
import { digits, span, when, whole } from "./format.js";
import { steering } from "./studies.js";

const STAGES = ["sampling", "training", "optimising", "verifying", "refining"];

function present(study) {
  return study.state === "paused" ? study.paused_from : study.state;
}

/** What is not to be believed of a study, and whose it is. */
function doubts(study) {
  const told = (study.distrusted ?? []).map((w) => h("p", { class: "fault", role: "alert" },
    `Results of ${w.name} are not believed${w.reason ? `: ${w.reason}` : ""}. `
    + `${w.replaced} were dropped and computed again, the study rests on ${w.disowned}.`));
  const open = study.audit_verdicts?.disputed ?? 0;
  return open ? [...told, h("p", { class: "hint" }, `Two workers differ about ${open} samples; the coordinator flies them.`)] : told;
}

/** Stages done, the present one, and those to come. */
function rail(study) {
  const now = STAGES.indexOf(present(study));
  const times = study.stages_s;
  const begun = STAGES.filter((stage) => times[stage] !== null && times[stage] !== undefined);
  const last = STAGES.indexOf(begun.at(-1));
  const at = (stage, i) => {
    if (now >= 0) return i < now ? (begun.includes(stage) ? "done" : "skipped") : i === now ? "now" : "later";
    if (!begun.includes(stage)) return "later";
    return i === last && study.state !== "succeeded" ? "broken" : "done";
  };
  const said = { done: "done", now: "now", broken: study.state, later: "", skipped: "" };
  return h("ol", { class: "rail", "aria-label": "Stages" }, STAGES.map((stage, i) => {
    const where = at(stage, i);
    return h("li", { "data-at": where, "aria-current": where === "now" ? "step" : null }, stage,
      h("small", {}, times[stage] === null || times[stage] === undefined ? "" : span(times[stage]), where === "later" || where === "skipped" ? "" : ` · ${said[where]}`));
  }));
}

/** Steps done and all of the present stage. */
function far(study) {
  const jobs = study.stage_jobs;
  const all = jobs.ready + jobs.delayed + jobs.leased + jobs.succeeded + jobs.infeasible + jobs.dead;
  if (present(study) === "sampling") return [study.samples.succeeded, study.spec.sampling.samples];
  if (study.progress) return [study.progress.done, study.progress.total];
  return [jobs.succeeded + jobs.infeasible, all];
}

/** Whether an optimum as flown carries the weight, without drag or moment: to 0.01 and twice its standard errors. */
function inTrim(optimum) {
  const flown = optimum.search?.standing.best?.scaled ?? optimum.simulated;
  if (!flown?.lift) return false;
  const { lift, drag, pitch_moment: moment } = flown;
  const off = Math.abs(1 - lift.mean) + Math.abs(drag.mean) + Math.abs(moment.mean);
  return off <= 0.01 + 2 * (lift.se + drag.se + moment.se);
}

function facts(study) {
  const pairs = [];
  const add = (name, value) => value !== null && value !== undefined && value !== "-" && pairs.push([name, value]);
  const jobs = study.stage_jobs;
  add("Samples flown", `${whole(study.samples.succeeded)} of ${whole(study.spec.sampling.samples)}`);
  add("Rate", study.rate_per_s ? `${digits(study.rate_per_s, 3)} /s` : null);
  add("Left", study.eta_s !== null && study.eta_s !== undefined ? span(study.eta_s) : null);
  if (jobs.leased) add("Being computed", whole(jobs.leased));
  if (jobs.delayed) add("To be tried again", whole(jobs.delayed));
  if (study.samples.infeasible) add("Cannot be flown", whole(study.samples.infeasible));
  if (study.samples.dead) add("Given up", whole(study.samples.dead));
  if (study.surrogate) add("Test error of P+ (rms)", digits(study.surrogate.rmse.power, 3));
  const known = study.optimisations.filter(inTrim).map((o) => o.search?.standing.power_per_lift_w_per_n ?? o.simulated?.power_per_lift_w_per_n).filter(Boolean);
  if (known.length) add("Best P/L", `${digits(Math.min(...known), 4)} W/N`);
  return h("dl", { class: "facts" }, pairs.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
}

/** The head of a study's page. */
export function stagesPanel(id, look) {
  const head = h("div", { class: "row" });
  const body = h("div", {});
  let steered = null;
  return {
    root: h("div", {}, head, h("div", { class: "card" }, body)),
    update(study) {
      // Buttons are made anew only for another state: a press must not fall between two of them.
      if (steered !== study.state) {
        steered = study.state;
        head.replaceChildren(h("h1", {}, study.spec.name), badge(study.state), h("span", { class: "grow soft small" }, `submitted ${when(study.created_at)}${study.submitted_by ? ` by ${study.submitted_by}` : ""}`),
          steering(id, study.state, look));
      }
      const [done, all] = far(study);
      const moving = present(study) && STAGES.includes(present(study));
      fill(body,
        study.spec.description ? h("p", { class: "soft" }, study.spec.description) : null,
        rail(study),
        study.failure ? h("p", { class: "fault", role: "alert" }, study.failure) : null,
        ...doubts(study),
        moving ? h("progress", { max: all || 1, value: done, "aria-label": `${present(study)}: ${done} of ${all}` }) : null,
        moving ? h("p", {}, `${present(study)}: ${whole(done)} of ${whole(all)}`, study.progress?.note ? ` · ${study.progress.note}` : "",
          study.state === "paused" ? " · paused" : "") : null,
        facts(study));
    },
  };
}
