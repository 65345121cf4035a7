// One study: its head, and a tab for each thing there is to see.

import { get } from "./api.js";
import { sweep } from "./charts.js";
import { calm, h } from "./dom.js";
import { MOVING } from "./format.js";
import { stagesPanel } from "./stages.js";
import { workersCard } from "./workers.js";
import { failuresCard } from "./failures.js";
import { throughputCard } from "./throughput.js";
import { curveCard, errorsCard } from "./training.js";
import { explorerCard } from "./explorer.js";
import { optimaTab } from "./optimum.js";
import { frontCard } from "./front.js";
import { strokeTab } from "./stroke.js";

/** Between two looks at a long job, whose progress is no event, ms. */
const LOOK = 3000;

const grid = (...cards) => {
  const root = h("div", { class: "grid" }, cards.map((c) => c.root));
  return { root, update: (...args) => cards.forEach((c) => c.update?.(...args)) };
};

const TABS = {
  overview: ["Overview", (id, look) => {
    const wide = workersCard();
    wide.root.classList.add("wide");
    return grid(throughputCard(id), failuresCard(id, look), wide);
  }],
  surrogate: ["Surrogate", (id) => grid(curveCard(id), errorsCard(id))],
  dataset: ["Dataset", (id) => explorerCard(id)],
  optima: ["Optima", (id) => {
    const parts = [optimaTab(id), frontCard(id)];
    return { root: h("div", {}, parts.map((part) => part.root)), update: (study) => parts.forEach((part) => part.update(study)) };
  }],
  stroke: ["Stroke", (id) => strokeTab(id)],
};

/** The page of a study. */
export function studyPage(id, signal) {
  const look = () => refresh();
  const head = stagesPanel(id, look);
  const links = Object.entries(TABS).map(([name, [title]]) => h("a", { href: `#/studies/${id}/${name}` }, title));
  const body = h("div", { id: "tab" }, h("p", { class: "hint" }, "Loading ..."));
  const root = h("div", {}, head.root, h("nav", { class: "tabs", "aria-label": "Parts of the study" }, links), body);
  const made = new Map();
  let study = null, open = "overview";

  const tab = () => {
    if (!made.has(open)) made.set(open, TABS[open][1](id, look));
    return made.get(open);
  };
  const show = () => {
    if (!study || signal.aborted) return;
    document.title = `${study.spec.name} · manduca`;
    head.update(study);
    tab().update(study);
  };
  const refresh = calm(async () => {
    try {
      study = await get(`/v1/studies/${id}`, signal);
    } catch (error) {
      if (signal.aborted) return;
      if (error.status === 404) root.replaceChildren(h("h1", {}, "There is no such study"), h("p", {}, h("a", { href: "#/studies" }, "All studies")));
      return;
    }
    show();
  }, 700);

  const timer = setInterval(() => study && MOVING.includes(study.state) && refresh(), LOOK);
  signal.addEventListener("abort", () => { clearInterval(timer); document.title = "manduca"; setTimeout(sweep); });

  return {
    root,
    update: refresh,
    go(parts) {
      open = parts[2] in TABS ? parts[2] : "overview";
      links.forEach((link, i) => (Object.keys(TABS)[i] === open ? link.setAttribute("aria-current", "page") : link.removeAttribute("aria-current")));
      body.replaceChildren(tab().root);
      show();
    },
  };
}
