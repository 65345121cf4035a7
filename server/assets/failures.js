// Jobs which failed or cannot be flown, alike ones together.

import { get, post } from "./api.js";
import { badge, calm, card, fill, h, table } from "./dom.js";
import { whole } from "./format.js";

/** Groups with their reasons; jobs given up can be tried again. */
export function failuresCard(id, look) {
  const body = h("div", {}, h("p", { class: "hint" }, "None so far."));
  const explained = h("div", { "aria-live": "polite" });
  const explain = async (job) => {
    const told = await get(`/v1/jobs/${job}/explain`);
    fill(explained, h("h3", {}, `Job ${job}`), h("ul", {}, told.because.map((line) => h("li", {}, line))));
  };
  const retry = async () => {
    try {
      await post(`/v1/studies/${id}/retry-failed`);
    } catch (error) {
      fill(explained, h("p", { class: "fault" }, error.message));
    }
    look();
  };
  const load = calm(async () => {
    const groups = await get(`/v1/studies/${id}/failures`);
    if (groups.length === 0) return fill(body, h("p", { class: "hint" }, "No job failed, and every stroke could be flown."));
    const dead = groups.filter((g) => g.state === "dead").reduce((sum, g) => sum + g.jobs, 0);
    body.replaceChildren(
      table("Numbers are left out of the reasons; one job of each kind explains itself", [
        ["Reason", (g) => g.reason],
        ["State", (g) => badge(g.state)],
        ["For", (g) => g.role],
        ["Jobs", (g) => whole(g.jobs), true],
        ["Example", (g) => h("button", { type: "button", title: g.example_reason, onclick: () => explain(g.example) }, `job ${g.example}`)],
      ], groups, true),
      dead ? h("button", { type: "button", class: "main", onclick: retry }, `Try ${whole(dead)} given up again`) : "");
  }, 3000);
  let known = "";
  return {
    root: card("Failed and infeasible", body, explained),
    update(study) {
      const counts = [study.samples, study.stage_jobs].map((c) => [c.infeasible, c.dead, c.delayed]).join();
      if (counts === known) return;
      known = counts;
      load();
    },
  };
}
