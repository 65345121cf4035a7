// Elements, made without markup: nothing that comes from a server is ever read as HTML.

/** An element with attributes (functions are listeners, true and false are presence) and children. */
export function h(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (typeof value === "function") node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else node.setAttribute(name, value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return node;
}

/** Puts other children into a node, or leaves it alone where they say the same. */
export function fill(node, ...children) {
  const fresh = document.createElement("div");
  fresh.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  // What has the focus or is being read is not replaced by its like.
  if (fresh.innerHTML !== node.innerHTML) node.replaceChildren(...fresh.childNodes);
  return node;
}

/** A card with a heading. */
export function card(title, ...children) {
  return h("section", { class: "card" }, h("h2", {}, title), ...children);
}

/** A table; a column is [heading, cell(row), isNumber]. `stack` makes rows into blocks on a phone. */
export function table(caption, columns, rows, stack = false) {
  const heads = columns.map(([name, , number]) => h("th", { scope: "col", class: number ? "number" : null }, name));
  const cells = (row) => columns.map(([name, cell, number], i) => {
    const first = i === 0;
    const told = cell(row) ?? "-";
    return h(first ? "th" : "td", {
      scope: first ? "row" : null, class: told === "" ? "empty" : number ? "number" : null, "data-label": first ? null : name,
    }, told);
  });
  return h("div", { class: "scroll" }, h("table", { class: stack ? "stack" : null },
    caption ? h("caption", {}, caption) : null,
    h("thead", {}, h("tr", {}, heads)),
    h("tbody", {}, rows.map((row) => h("tr", {}, cells(row))))));
}

/** The coloured name of a state. */
export function badge(state) {
  return h("span", { class: "state", "data-state": state }, state);
}

/** Asks before `action` is done; resolves to true if it is to be, and to false if `otherwise` is chosen. */
export function confirmed(question, action, otherwise = "Cancel") {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-label": question, onclose: () => { dialog.remove(); resolve(dialog.returnValue === "yes"); } },
      h("form", { method: "dialog" }, h("p", {}, question),
        h("div", { class: "row" }, h("span", { class: "grow" }), h("button", { value: "no" }, otherwise),
          h("button", { value: "yes", class: "main" }, action))));
    document.body.append(dialog);
    dialog.showModal();
  });
}

/** Runs at most every so many ms, and once more after the last call meanwhile. */
export function calm(action, ms) {
  let last = -Infinity, timer = null;
  return () => {
    if (timer) return;
    timer = setTimeout(() => { timer = null; last = performance.now(); action(); }, Math.max(0, last + ms - performance.now()));
  };
}
