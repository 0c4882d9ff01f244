"use strict";
/* Filters of the page of a fleet: panels whose vehicle, figure and parts hold all words, and those with alarms alone. */
(() => {
  const main = document.querySelector("main"), bar = document.createElement("div");
  bar.className = "filter";
  bar.innerHTML = '<input type="search" placeholder="vehicle, figure or part" aria-label="Show vehicles, figures and parts with"> '
    + '<label><input type="checkbox"> alarms only</label> <output></output>';
  const [words, alarms] = bar.querySelectorAll("input"), told = bar.querySelector("output");
  const vehicles = [...main.querySelectorAll("section")].map(section => ({
    block: section.closest("details") || section,
    panels: [...section.querySelectorAll(".panels > figure")].map(figure => ({figure, alarm: !!figure.querySelector(".edge")})),
    title: (section.closest("details") || section).querySelector("h2").textContent,
  })).filter(vehicle => vehicle.panels.length);
  const text = figure => figure.querySelector(".title").textContent + " "
    + [...figure.querySelectorAll(".part")].map(one => one.textContent).join(" ");
  function update() {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0, found = [];
    for (const {block, panels, title} of vehicles) {
      let any = 0;
      for (const {figure, alarm} of panels) {
        const own = wanted.length ? (title + " " + text(figure)).toLowerCase() : "";
        const fits = (alarm || !alarms.checked) && wanted.every(word => own.includes(word));
        figure.hidden = !fits;
        any += fits;
      }
      block.hidden = !any;
      shown += any;
      if (any) found.push(block);
    }
    if (wanted.length && found.length <= 10) for (const block of found) if ("open" in block) block.open = true;
    told.textContent = wanted.length || alarms.checked ? `${shown} panels of ${found.length} vehicles` : "";
  }
  bar.addEventListener("input", update);
  if (vehicles.length) vehicles[0].block.before(bar);
})();
