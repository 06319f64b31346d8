"use strict";
const report = JSON.parse(document.getElementById("data").textContent);
for (const root of document.querySelectorAll("[data-capture]")) {
  const capture = report.captures[Number(root.dataset.capture)];
  const compare = root.querySelector(".compare"), orbit = root.querySelector(".orbit");
  if (compare) makeSlider(compare, capture);
  if (orbit) makeOrbit(orbit, capture);
}
window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((one) => { one.open = true; }));
document.documentElement.dataset.ready = "true";
