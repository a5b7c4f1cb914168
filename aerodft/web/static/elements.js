// Elements of the page: found by their ids, made, and filled.

export const find = (id) => document.getElementById(id);

export function element(name, text = "", properties = {}) {
  return Object.assign(document.createElement(name), { textContent: text, ...properties });
}

export function fillList(list, texts) { // only where it says something else
  if (list.dataset.texts === texts.join("\n")) return;
  list.dataset.texts = texts.join("\n");
  list.replaceChildren(...texts.map((text) => element("li", text)));
}
