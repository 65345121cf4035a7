// The frame of the page: which view is shown, light or dark, and whether the coordinator is heard.

import { watch, Refusal } from "./api.js";
import { h, fill } from "./dom.js";
import { repaint } from "./charts.js";
import { listPage } from "./studies.js";
import { workersPage } from "./workers.js";
import { submitPage } from "./submit.js";
import { studyPage } from "./study.js";

const content = document.getElementById("content");
const live = document.getElementById("live");
const THEME = "manduca-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

function paint() {
  const chosen = localStorage.getItem(THEME) ?? (dark.matches ? "dark" : "light");
  document.documentElement.dataset.theme = chosen;
  repaint();
}

document.getElementById("theme").addEventListener("click", () => {
  const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  if (next === (dark.matches ? "dark" : "light")) localStorage.removeItem(THEME);
  else localStorage.setItem(THEME, next);
  paint();
});
dark.addEventListener("change", paint);
paint();

const SAID = { live: "live", polling: "asking now and then", away: "no answer", connecting: "connecting" };

function told(state) {
  live.dataset.state = state;
  live.textContent = SAID[state];
}

/** The parts of the address after `#/`. */
function place() {
  return location.hash.replace(/^#\/?/, "").split("/").filter(Boolean).map(decodeURIComponent);
}

let shown = { path: null, end: null, page: null };

/** Shows what the address names. A page is { root, update(change), go(parts) }. */
function show() {
  const parts = place();
  const path = parts[0] === "studies" ? parts.slice(0, 2).join("/") : parts[0] ?? "studies";
  for (const link of document.querySelectorAll(".bar nav a")) {
    const here = link.getAttribute("href") === `#/${parts[0] ?? "studies"}`;
    if (here) link.setAttribute("aria-current", "page"); else link.removeAttribute("aria-current");
  }
  if (shown.path === path) return shown.page.go?.(parts);
  shown.end?.abort();
  const end = new AbortController();
  const [kind, id] = parts;
  const page = kind === "workers" ? workersPage()
    : kind === "new" ? submitPage()
      : kind === "studies" && id ? studyPage(id, end.signal)
        : listPage();
  shown = { path, end, page };
  content.replaceChildren(page.root);
  page.go?.(parts);
  scrollTo(0, 0);
  const update = (change) => Promise.resolve(page.update?.(change)).catch((error) => {
    if (error.name === "AbortError" || end.signal.aborted) return;
    if (error instanceof Refusal && error.status === 404) {
      fill(content, h("h1", {}, "Not there"), h("p", {}, error.message), h("p", {}, h("a", { href: "#/studies" }, "All studies")));
    } else if (!(error instanceof TypeError)) throw error;
  });
  update({ studies: [], workers: true, everything: true });
  watch(kind === "studies" && id ? id : null, end.signal, update, told);
}

addEventListener("hashchange", () => { show(); content.focus({ preventScroll: true }); });
show();
