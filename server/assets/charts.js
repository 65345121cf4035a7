// Charts. The library is fetched when the first chart comes into view, not before.

import { h } from "./dom.js";

const LIBRARY = "/assets/vendor/plotly-strict-4.1.1.min.js.gz";
let library = null;

function plotly() {
  library ??= new Promise((resolve, reject) => {
    const script = h("script", { src: LIBRARY, onload: () => resolve(window.Plotly), onerror: () => { library = null; reject(new Error("the charts could not be fetched")); } });
    document.head.append(script);
  });
  return library;
}

/** A colour of the style sheet. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** From blue over neutral to red, for what may have either sign. */
export const SIGNED = [[0, "#2166ac"], [0.25, "#92c5de"], [0.5, "#d9d9d9"], [0.75, "#f4a582"], [1, "#b2182b"]];
/** Dark to bright, for those who see colours otherwise too. */
export const SCALE = "Viridis";

const shown = new Map();
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) if (entry.isIntersecting && shown.has(entry.target)) paint(entry.target);
}, { rootMargin: "200px" });

function axis(more = {}) {
  const title = typeof more.title === "string" ? { text: more.title, standoff: 6 } : more.title;
  return { gridcolor: colour("grid"), zerolinecolor: colour("line"), linecolor: colour("line"), automargin: true, ...more, title };
}

function dress(layout) {
  const axes = {};
  for (const [name, value] of Object.entries(layout)) if (/^[xy]axis\d*$/.test(name)) axes[name] = axis(value);
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, sans-serif", size: 12, color: colour("ink") },
    margin: { l: 48, r: 12, t: 12, b: 38 }, hoverlabel: { font: { size: 12 } },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("soft"), activecolor: colour("accent") },
    colorway: ["c1", "c2", "c3", "c4"].map(colour),
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
    xaxis: axis(), yaxis: axis(), ...layout, ...axes,
  };
}

async function paint(node) {
  const wanted = shown.get(node);
  if (!wanted || wanted.busy) { if (wanted) wanted.again = true; return; }
  wanted.busy = true;
  try {
    if (node.dataset.broken) {
      node.replaceChildren();
      delete node.dataset.broken;
    }
    const { react } = await plotly();
    do {
      wanted.again = false;
      const { traces, layout } = wanted.make();
      if (!node.isConnected) break;
      node.style.height = `${layout.height ?? 300}px`;
      const coarse = matchMedia("(pointer: coarse)").matches;
      await react(node, traces, dress(layout), {
        responsive: true, displaylogo: false, displayModeBar: coarse ? false : "hover",
        modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      });
    } while (wanted.again);
    node.dataset.drawn = "yes";
  } catch (error) {
    // Half of a chart is no beginning for the next one.
    window.Plotly?.purge(node);
    node.textContent = `The chart cannot be drawn: ${error.message}`;
    node.dataset.broken = "yes";
  }
  wanted.busy = false;
}

/** Draws all charts again, in other colours. */
export function repaint() {
  for (const node of shown.keys()) if (node.isConnected) paint(node);
}

/** A chart with its text alternative. */
export function chart(caption) {
  const node = h("div", { class: "plot", role: "img", hidden: true });
  const text = h("figcaption", {}, caption);
  const figure = h("figure", {}, node, text);
  return {
    figure,
    node,
    /** Shows what `make` gives, { traces, layout }, once it is in view; `told` says it in words. */
    show(make, told = caption) {
      const fresh = !shown.has(node);
      const old = shown.get(node) ?? {};
      shown.set(node, Object.assign(old, { make }));
      node.hidden = false;
      node.setAttribute("aria-label", told);
      text.textContent = told;
      if (fresh) seen.observe(node); else if (node.dataset.drawn || old.busy) paint(node);
    },
  };
}

/** Forgets charts which are gone. */
export function sweep() {
  for (const node of shown.keys()) {
    if (node.isConnected) continue;
    seen.unobserve(node);
    if (node.dataset.drawn) window.Plotly?.purge(node);
    shown.delete(node);
  }
}

let gl = null;

/**
 * Whether this browser has WebGL, which parallel coordinates and views in space are drawn with. Points are drawn
 * without it everywhere: the library compiles code for points with WebGL, which the page's policy forbids.
 */
export function fast() {
  gl ??= Boolean(document.createElement("canvas").getContext("webgl"));
  return gl;
}
