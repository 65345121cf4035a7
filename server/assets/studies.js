// The list of studies.

import { get, post } from "./api.js";
import { badge, calm, confirmed, fill, h, table } from "./dom.js";
import { ENDED, MOVING, when, whole } from "./format.js";

const PAGE = 50;

/** Buttons by which a study in this state is steered. */
export function steering(id, state, after) {
  const faults = h("span", { class: "small", role: "alert" });
  const act = async (action, question) => {
    if (question && !(await confirmed(question, "Cancel the study", "Keep the study"))) return;
    try {
      await post(`/v1/studies/${id}/${action}`);
      faults.textContent = "";
    } catch (error) {
      faults.textContent = error.message;
    }
    after();
  };
  const button = (action, name, more = {}) => h("button", { type: "button", onclick: () => act(action, more.question), class: more.class }, name);
  return h("span", { class: "row" },
    MOVING.includes(state) ? button("pause", "Pause") : null,
    state === "paused" ? button("resume", "Resume", { class: "main" }) : null,
    ENDED.includes(state) ? null : button("cancel", "Cancel", { class: "danger", question: "Cancel this study for good? What was flown stays." }),
    state === "failed" ? button("retry-failed", "Try failed jobs again", { class: "main" }) : null,
    faults);
}

function progress(study) {
  const share = study.samples ? study.samples_succeeded / study.samples : 0;
  return h("span", { class: "row" },
    h("progress", { max: study.samples || 1, value: study.samples_succeeded, "aria-label": "samples flown", class: "grow" }),
    study.samples ? h("span", { class: "small soft" }, `${whole(study.samples_succeeded)} of ${whole(study.samples)} (${Math.floor(100 * share)} %)`)
      : h("span", { class: "small soft" }, "flies as it searches"));
}

/** The page. */
export function listPage() {
  const list = h("div", {}, h("p", { class: "hint" }, "Loading ..."));
  const filter = h("select", { id: "state", onchange: () => { pages = 1; load(); } },
    h("option", { value: "" }, "all"),
    [...MOVING, "paused", ...ENDED].map((state) => h("option", { value: state }, state)));
  let pages = 1;
  const load = async () => {
    const studies = [];
    let cursor = null;
    try {
      for (let i = 0; i < pages; i++) {
        const query = new URLSearchParams({ limit: PAGE });
        if (filter.value) query.set("state", filter.value);
        if (cursor) query.set("cursor", cursor);
        const page = await get(`/v1/studies?${query}`);
        studies.push(...page.items);
        cursor = page.next_cursor;
        if (!cursor) break;
      }
    } catch (error) {
      fill(list, h("p", { class: "fault", role: "alert" }, `The studies cannot be shown: ${error.message}`));
      return;
    }
    show(studies, cursor);
  };
  const show = (studies, more) => {
    if (studies.length === 0) {
      fill(list, h("p", { class: "hint" }, filter.value ? "No study is in this state." : "There is no study yet. ",
        filter.value ? null : h("a", { href: "#/new" }, "Submit the first")));
      return;
    }
    const by = studies.some((s) => s.submitted_by);
    const columns = [
      ["Study", (s) => h("a", { href: `#/studies/${s.id}` }, s.name)],
      ["State", (s) => badge(s.state)],
      ["Samples", progress],
      ["Submitted", (s) => h("time", { datetime: s.created_at }, when(s.created_at))],
      ...(by ? [["By", (s) => s.submitted_by ?? ""]] : []),
      ["Steer", (s) => (s.state === "succeeded" || s.state === "cancelled" ? "" : steering(s.id, s.state, load))],
    ];
    list.replaceChildren(table("Newest first", columns, studies, true),
      more ? h("button", { type: "button", onclick: () => { pages += 1; load(); } }, "Show more") : "");
  };
  const root = h("div", {},
    h("div", { class: "row" }, h("h1", { class: "grow" }, "Studies"), h("label", { for: "state" }, "State"), filter,
      h("a", { href: "#/new" }, "New study")),
    h("div", { class: "card" }, list));
  return { root, update: calm(load, 1000) };
}
