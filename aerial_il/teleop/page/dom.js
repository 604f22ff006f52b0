// Small words for the page's elements.

export const $ = (id) => document.getElementById(id);

export function setText(element, text) { if (element.textContent !== text) element.textContent = text; }

export function setHidden(element, hidden) { if (element.hidden !== hidden) element.hidden = hidden; }

export function make(tag, text = "", attributes = {}) {
  const element = document.createElement(tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

export const keycap = (text) => make("kbd", text);

export const words = (name) => name.replaceAll("_", " ");

export function clock(seconds) {
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(1).padStart(4, "0")}`;
}
