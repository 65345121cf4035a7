// A study comes in: one of those built in, or one's own, in TOML or JSON.

import { Refusal, post, text } from "./api.js";
import { fill, h } from "./dom.js";
import { whole } from "./format.js";

const STUDIES = [
  ["quick", "quick: 2000 strokes, minutes"],
  ["paper", "paper: 5000 strokes, 500 neurons, cases I and II"],
  ["five", "five: the paper's five-parameter case"],
  ["five-direct", "five-direct: the same by simulations alone"],
  ["truth", "truth: strokes flown long, to judge a surrogate by"],
];

/** A key under which a submission pressed twice is one study. */
function key() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (b) => b.toString(16).padStart(2, "0")).join("");
}

/** Where in the text a fault is: its line if told, else the field's name. */
function place(content, fault) {
  const lines = content.split("\n");
  const told = /^line (\d+): /.exec(fault.detail);
  let line = told ? Number(told[1]) - 1 : -1;
  const parts = fault.pointer.split("/").filter((part) => part && !/^\d+$/.test(part));
  while (line < 0 && parts.length) {
    const name = parts.pop();
    line = lines.findIndex((l) => new RegExp(`^\\s*(\\[+.*\\b${name}\\b|"?${name}"?\\s*[:=])`).test(l));
  }
  if (line < 0) return null;
  const start = lines.slice(0, line).reduce((sum, l) => sum + l.length + 1, 0);
  return [start, start + lines[line].length];
}

/** The page. */
export function submitPage() {
  const area = h("textarea", { id: "text", rows: 26, spellcheck: "false", "aria-describedby": "told" });
  const told = h("div", { id: "told", "aria-live": "polite" });
  const choice = h("select", { id: "built-in", onchange: () => load(choice.value) }, STUDIES.map(([name, title]) => h("option", { value: name }, title)));
  let idempotency = key();

  const load = async (name) => {
    try {
      area.value = await text(`/assets/studies/${name}.toml`);
      fill(told);
    } catch (error) {
      fill(told, h("p", { class: "fault" }, error.message));
    }
  };
  const show = (fault) => {
    const at = place(area.value, fault);
    if (!at) return;
    area.focus();
    area.setSelectionRange(...at);
    const lines = area.value.slice(0, at[0]).split("\n").length;
    area.scrollTop = Math.max(0, (lines - 5) * parseFloat(getComputedStyle(area).lineHeight));
  };
  const faults = (title, list) => fill(told, h("div", { class: "fault", role: "alert" }, h("strong", {}, title),
    h("ul", {}, list.map((fault) => h("li", {}, h("button", { type: "button", onclick: () => show(fault) }, h("code", {}, fault.pointer || "/")), ` ${fault.detail}`)))));
  const send = (query, more = {}) => {
    const type = area.value.trimStart().startsWith("{") ? "application/json" : "application/toml";
    return post(`/v1/studies${query}`, area.value, { "content-type": type, ...more });
  };
  const refused = (error) => (error instanceof Refusal && error.problem?.errors?.length
    ? faults(error.message, error.problem.errors) : fill(told, h("p", { class: "fault", role: "alert" }, error.message)));
  const check = async () => {
    try {
      const answer = await send("?dry_run=true");
      if (answer.errors.length) faults("It would be refused:", answer.errors);
      else fill(told, h("p", { class: "good" }, `It would be accepted: ${whole(answer.simulations)} simulations before refining.`));
    } catch (error) {
      refused(error);
    }
  };
  const submit = async () => {
    buttons.forEach((button) => { button.disabled = true; });
    try {
      const study = await send("", { "idempotency-key": idempotency });
      location.hash = `#/studies/${study.id}`;
    } catch (error) {
      refused(error);
    }
    buttons.forEach((button) => { button.disabled = false; });
  };
  area.addEventListener("input", () => { idempotency = key(); });
  choice.addEventListener("change", () => { idempotency = key(); });
  const file = h("input", { type: "file", id: "file", accept: ".toml,.json", onchange: async () => { if (file.files[0]) { area.value = await file.files[0].text(); fill(told); } } });
  const buttons = [h("button", { type: "button", onclick: check }, "Check"), h("button", { type: "button", class: "main", onclick: submit }, "Submit")];
  load("quick");
  return {
    root: h("div", {}, h("h1", {}, "New study"),
      h("div", { class: "card" },
        h("div", { class: "row" }, h("label", { for: "built-in" }, "Begin with"), choice, h("label", { for: "file" }, "or a file"), file),
        h("p", { class: "soft small" }, "TOML or JSON. Everything but ", h("code", {}, "name"), " and ", h("code", {}, "sampling.samples"),
          " has a default; what is misspelt or out of range is refused, with its place."),
        h("label", { for: "text" }, "The study"), area, h("div", { class: "row" }, h("span", { class: "grow" }), buttons), told)),
  };
}
