// The coordinator's REST interface: requests, refusals, tokens, and the stream of changes.

import { h } from "./dom.js";

const TOKEN = "manduca-token";
/** How often a page asks where the stream of changes is broken, ms. */
const POLL = 4000;

/** What the coordinator refused. */
export class Refusal extends Error {
  constructor(status, problem) {
    super(problem?.detail ?? `the coordinator answered ${status}`);
    this.status = status;
    this.problem = problem;
  }
}

function headers(more) {
  const token = sessionStorage.getItem(TOKEN);
  return token ? { ...more, authorization: `Bearer ${token}` } : { ...more };
}

let asking = null;

/** Asks for a token, once for all who wait for it. */
function token() {
  asking ??= new Promise((resolve) => {
    const input = h("input", { id: "token", type: "password", autocomplete: "off", required: true, minlength: 20 });
    const dialog = h("dialog", {
      "aria-labelledby": "token-title",
      onclose: () => {
        dialog.remove();
        asking = null;
        if (dialog.returnValue === "use") sessionStorage.setItem(TOKEN, input.value.trim());
        resolve(dialog.returnValue === "use");
      },
    }, h("form", { method: "dialog" },
      h("h2", { id: "token-title" }, "This coordinator asks for a token"),
      h("p", { class: "soft" }, "The scope read shows everything, submit also steers. It is kept until this tab is closed."),
      h("label", { for: "token" }, "Token"), input,
      h("div", { class: "row" }, h("span", { class: "grow" }), h("button", { value: "use", class: "main" }, "Use it"))));
    document.body.append(dialog);
    dialog.showModal();
  });
  return asking;
}

async function ask(path, options) {
  for (;;) {
    const answer = await fetch(path, { ...options, headers: headers(options.headers), cache: "no-cache" });
    if (answer.status === 401 && (await token())) continue;
    return answer;
  }
}

async function checked(answer) {
  if (answer.ok) {
    const body = await answer.text();
    return body ? JSON.parse(body) : null;
  }
  let problem = null;
  try { problem = await answer.json(); } catch { /* not of the coordinator: a proxy perhaps */ }
  throw new Refusal(answer.status, problem);
}

/** What is at a path. */
export async function get(path, signal) {
  return checked(await ask(path, { signal }));
}

/** A text at a path. */
export async function text(path) {
  const answer = await ask(path, {});
  if (!answer.ok) throw new Refusal(answer.status, null);
  return answer.text();
}

/** Sends something, JSON unless said otherwise. */
export async function post(path, body, more = {}, signal = undefined) {
  const sent = typeof body === "string" ? body : JSON.stringify(body ?? {});
  return checked(await ask(path, { method: "POST", body: sent, headers: { "content-type": "application/json", ...more }, signal }));
}

/** Follows a link to a file; where a token is asked for, which no link carries, in its stead. */
export async function take(event) {
  const link = event.currentTarget;
  if (!sessionStorage.getItem(TOKEN)) return;
  event.preventDefault();
  const answer = await ask(link.getAttribute("href"), {});
  if (!answer.ok) throw new Refusal(answer.status, null);
  const url = URL.createObjectURL(await answer.blob());
  h("a", { href: url, download: link.getAttribute("download") }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}

let reference = null;

/** What is the same for all studies. */
export function constants() {
  reference ??= get("/v1/reference").catch((error) => { reference = null; throw error; });
  return reference;
}

let routes = null;

/** Whether this coordinator has a route. */
export async function offers(path) {
  routes ??= get("/openapi.json").then((document) => document.paths).catch(() => { routes = null; return {}; });
  return path in ((await routes) ?? {});
}

/** Events of a stream as they come in. */
async function* events(body) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n\n");
    rest = parts.pop();
    for (const part of parts) {
      const data = part.split("\n").filter((line) => line.startsWith("data:")).map((line) => line.slice(5)).join("\n");
      if (data) yield JSON.parse(data);
    }
  }
}

const pause = (ms, signal) => new Promise((resolve) => {
  const timer = setTimeout(resolve, ms);
  signal.addEventListener("abort", () => { clearTimeout(timer); resolve(); }, { once: true });
});

/** Waits until the page is looked at, or `signal` says to wait no more. */
const lookedAt = (signal) => new Promise((resolve) => {
  if (!document.hidden) { resolve(); return; }
  document.addEventListener("visibilitychange", resolve, { once: true });
  signal.addEventListener("abort", resolve, { once: true });
});

/** Ends when `signal` does, or the page is looked at no more: a browser holds few connections for all its tabs. */
function whileLookedAt(signal) {
  const end = new AbortController();
  document.addEventListener("visibilitychange", () => document.hidden && end.abort(), { signal: end.signal });
  signal.addEventListener("abort", () => end.abort(), { signal: end.signal });
  return end.signal;
}

/** Tells of changes until `signal` ends it: by the stream, and while that is broken by looking now and then. */
export async function watch(study, signal, changed, told) {
  const path = study ? `/v1/events?study=${encodeURIComponent(study)}` : "/v1/events";
  while (!signal.aborted) {
    await lookedAt(signal);
    if (signal.aborted) return;
    const shown = whileLookedAt(signal);
    try {
      const answer = await ask(path, { signal: shown });
      if (!answer.ok) throw new Refusal(answer.status, null);
      told("live");
      for await (const change of events(answer.body)) changed(change);
    } catch { /* whatever it is, the next look tells */ }
    if (signal.aborted) return;
    if (document.hidden) continue;
    try {
      const alive = await fetch("/healthz", { signal });
      told(alive.ok ? "polling" : "away");
      changed({ studies: [], workers: true, everything: true });
    } catch {
      if (!signal.aborted) told("away");
    }
    await pause(POLL, signal);
  }
}
