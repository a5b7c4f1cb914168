// @ts-check
// Elements of the page: found by their ids, made, and filled.

/**
 * The element of the page with an id.
 * @template {string} Id
 * @param {Id} id
 * @returns {Id extends keyof ElementOfId ? ElementOfId[Id] : HTMLElement}
 */
export const find = (id) => /** @type {any} */ (document.getElementById(id));

/** @returns {HTMLButtonElement[]} The buttons that take a tool in hand. */
export const toolButtons = () => [...document.querySelectorAll("button[data-kind]")].map((each) => /** @type {any} */ (each));

/**
 * Where an event happened, as one of the page's elements.
 * @param {Event} event
 * @returns {any}
 */
export const targetOf = (event) => event.target;

/**
 * @template {keyof HTMLElementTagNameMap} Name
 * @param {Name} name
 * @param {string} text
 * @param {object} properties
 * @returns {HTMLElementTagNameMap[Name]}
 */
export function element(name, text = "", properties = {}) {
  return Object.assign(document.createElement(name), { textContent: text, ...properties });
}

/**
 * Fill a list, only where it says something else.
 * @param {HTMLElement} list
 * @param {string[]} texts
 */
export function fillList(list, texts) {
  if (list.dataset.texts === texts.join("\n")) return;
  list.dataset.texts = texts.join("\n");
  list.replaceChildren(...texts.map((text) => element("li", text)));
}
