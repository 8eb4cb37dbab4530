// Values of charts under the pointer or by arrow keys, and the switch between light and dark.
(() => {
"use strict";
const button = document.getElementById("theme"), html = document.documentElement;
const dark = () => getComputedStyle(html).getPropertyValue("--dark").trim() === "1";
const name = () => { button.textContent = dark() ? "Light" : "Dark"; };
html.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
button.hidden = false;
name();
button.addEventListener("click", () => {
  html.dataset.theme = dark() ? "light" : "dark";
  name();
  document.dispatchEvent(new Event("themechange"));
});
// Paper is white.
let before = "";
addEventListener("beforeprint", () => { before = html.dataset.theme; html.dataset.theme = "light"; document.dispatchEvent(new Event("themechange")); });
addEventListener("afterprint", () => { html.dataset.theme = before; document.dispatchEvent(new Event("themechange")); });

// Window and level of the mammograms, in shares of the grey that is shown: out = (in - level) / window + 1/2.
for (const controls of document.querySelectorAll('[data-part="window"]')) {
  const [width, level] = controls.querySelectorAll("input"), films = controls.closest("figure").querySelectorAll(".film img");
  const show = () => {
    const [w, l] = [width.value / 100, level.value / 100];
    for (const image of films) image.style.filter = `brightness(${1 / (2 * l)}) contrast(${2 * l / w})`;
    controls.querySelector("output").textContent = `${width.value} %, ${level.value} %`;
  };
  width.addEventListener("input", show);
  level.addEventListener("input", show);
  controls.querySelector("button").addEventListener("click", () => { width.value = 100; level.value = 50; show(); });
}

for (const svg of document.querySelectorAll("figure svg")) {
  const hits = [...svg.querySelectorAll(".hit")];
  if (!hits.length) continue;
  const figure = svg.closest("figure"), tip = document.createElement("div");
  const texts = hits.map(hit => hit.querySelector("title").textContent);
  figure.classList.add("chart");
  tip.className = "tip";
  tip.hidden = true;
  tip.setAttribute("role", "status");
  figure.append(tip);
  svg.setAttribute("tabindex", "0");
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", `${figure.querySelector("b").textContent}; arrow keys go through the points`);
  // The browser's own tips would come late and on top of ours.
  hits.forEach(hit => hit.querySelector("title").remove());
  let at = -1;
  const place = hit => {
    const [point, box] = [hit.getBoundingClientRect(), figure.getBoundingClientRect()];
    return { x: point.left + point.width / 2 - box.left, y: point.top + point.height / 2 - box.top };
  };
  function show(n) {
    if (at >= 0) hits[at].classList.remove("on");
    at = n;
    tip.hidden = n < 0;
    if (n < 0) return;
    hits[n].classList.add("on");
    tip.textContent = texts[n];
    const { x, y } = place(hits[n]);
    tip.style.left = `${Math.max(0, Math.min(x + 12, figure.clientWidth - tip.offsetWidth))}px`;
    tip.style.top = `${y - 34}px`;
  }
  svg.addEventListener("pointermove", event => {
    const box = figure.getBoundingClientRect(), [u, v] = [event.clientX - box.left, event.clientY - box.top];
    let best = -1, least = 40 * 40;
    hits.forEach((hit, n) => {
      const { x, y } = place(hit), far = (x - u) ** 2 + (y - v) ** 2;
      if (far < least) { least = far; best = n; }
    });
    show(best);
  });
  svg.addEventListener("pointerleave", () => show(-1));
  svg.addEventListener("blur", () => show(-1));
  svg.addEventListener("keydown", event => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    show((at + step + hits.length) % hits.length);
  });
}
})();
