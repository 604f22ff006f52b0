// Light or dark: as the system says, until somebody chooses otherwise.

import { $ } from "./dom.js";
import { remember, remembered } from "./state.js";

const dark = () => (document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";

$("theme-button").addEventListener("click", () => {
  document.documentElement.dataset.theme = dark() ? "light" : "dark";
  remember("theme", document.documentElement.dataset.theme);
});

const wanted = remembered("theme");
if (wanted) document.documentElement.dataset.theme = wanted;
