// The workers: who is there, how fast, and how often they failed.

import { get, post } from "./api.js";
import { badge, calm, card, confirmed, fill, h, table } from "./dom.js";
import { digits, span, whole } from "./format.js";

/** Over how long a worker's rate is taken, ms. */
const WINDOW = 60000;

/** The list of workers; `update` looks again. */
export function workersPanel() {
  const body = h("div", {}, h("p", { class: "hint" }, "Loading ..."));
  const seen = new Map();
  const rate = (worker) => {
    const now = performance.now();
    const marks = (seen.get(worker.id) ?? []).filter(([at]) => now - at < WINDOW);
    marks.push([now, worker.completed]);
    seen.set(worker.id, marks);
    const [[first, before]] = marks;
    return now - first > 3000 ? (worker.completed - before) / ((now - first) / 1000) : null;
  };
  const state = (w) => (!w.alive ? "silent" : w.set_aside ? "not trusted" : w.quarantined ? "set aside" : w.draining ? "draining" : w.leased ? "working" : "idle");
  const told = h("div", { "aria-live": "polite" });
  const drain = async (worker) => {
    if (!(await confirmed(`Drain ${worker.name}? It finishes what it has in hand, takes nothing more, and leaves.`, "Drain worker"))) return;
    try {
      await post(`/v1/workers/${worker.id}/drain`);
      fill(told);
    } catch (error) {
      fill(told, h("p", { class: "fault" }, error.message));
    }
    update();
  };
  const leave = (w) => (w.alive && !w.draining
    ? h("button", { type: "button", "aria-label": `Drain ${w.name}`, onclick: () => drain(w) }, "Drain") : "");
  const update = calm(async () => {
    let workers, more;
    try {
      const page = await get("/v1/workers?limit=1000");
      workers = page.items.sort((a, b) => a.name.localeCompare(b.name));
      more = page.next_cursor;
    } catch (error) {
      fill(body, h("p", { class: "fault" }, error.message));
      return;
    }
    if (workers.length === 0) {
      fill(body, h("p", { class: "hint" }, "No worker is registered; those that have left are not listed. Start one: "),
        h("code", {}, `manduca worker --coordinator ${location.origin}`));
      return;
    }
    const alive = workers.filter((w) => w.alive);
    const slots = alive.reduce((sum, w) => sum + w.slots, 0);
    const rates = new Map(workers.map((w) => [w.id, rate(w)]));
    fill(body, h("p", { class: "soft" }, `${alive.length} alive with ${slots} slots${more ? ", and more: the first 1000 are shown" : ""}`),
      table(null, [
        ["Worker", (w) => w.name],
        ...(workers.some((w) => w.token) ? [["Token", (w) => w.token ?? ""]] : []),
        ["State", (w) => h("span", { title: w.set_aside ?? "" }, badge(state(w)))],
        ["Slots", (w) => w.slots, true],
        ["Jobs in hand", (w) => whole(w.leased), true],
        ["Jobs a second", (w) => digits(rates.get(w.id), 2), true],
        ["Done", (w) => whole(w.completed), true],
        ["Failed", (w) => (w.strikes ? `${w.failed} (${w.strikes} in a row)` : w.failed), true],
        ["Last heard of", (w) => (w.last_seen_s < 2 ? "now" : `${span(w.last_seen_s)} ago`), true],
        ["Arithmetic", (w) => w.level],
        ["Leave", leave],
      ], workers, true));
  }, 1500);
  return { body: h("div", {}, body, told), update };
}

/** The page of all workers. */
export function workersPage() {
  const panel = workersPanel();
  return { root: h("div", {}, h("h1", {}, "Workers"), h("div", { class: "card" }, panel.body)), update: panel.update };
}

/** The workers on a study's page. */
export function workersCard() {
  const panel = workersPanel();
  return { root: card("Workers", panel.body), update: panel.update };
}
