"use strict";
/* Filters of the page of a fleet: alarms and panels that hold all words, those with alarms alone, and those since a day. */
(() => {
  const main = document.querySelector("main"), bar = document.createElement("div");
  bar.className = "filter";
  bar.innerHTML = '<input type="search" placeholder="vehicle, figure, part, software or day" aria-label="Show what holds these words"> '
    + '<label><input type="checkbox"> alarms only</label> <label>alarms since <input type="date"></label> <output></output>';
  const [words, alarms, since] = bar.querySelectorAll("input"), told = bar.querySelector("output");
  const days = (node, place) => [...node.querySelectorAll(place)].map(one => one.dataset.began || one.textContent);
  const texts = (node, place) => [...node.querySelectorAll(place)].map(one => one.textContent).join(" ").toLowerCase();
  const rows = [...main.querySelectorAll("tr.told")].map(node => ({node, begun: days(node, "time")}));
  const vehicles = [...main.querySelectorAll("section")].map(section => ({
    block: section.closest("details") || section,
    panels: [...section.querySelectorAll(".panels > figure")].map(node => ({node, begun: days(node, ".edge")})),
    title: (section.closest("details") || section).querySelector("h2").textContent.toLowerCase(),
  })).filter(vehicle => vehicle.panels.length);
  function update() {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean), late = day => day >= since.value;
    const shows = (one, dated, own) => {
      one.node.hidden = (dated && !one.begun.some(late)) || !wanted.every(word => own().includes(word));
      return !one.node.hidden;
    };
    const dated = alarms.checked || since.value, found = [];
    const listed = rows.filter(one => shows(one, dated, () => one.text ??= texts(one.node, "th, td"))).length;
    let shown = 0;
    for (const {block, panels, title} of vehicles) {
      const own = panels.filter(one => shows(one, dated, () => one.text ??= title + " " + texts(one.node, ".title, .score, title")));
      block.hidden = !own.length;
      shown += own.length;
      if (own.length) found.push(block);
    }
    if (wanted.length && found.length <= 10) for (const block of found) if ("open" in block) block.open = true;
    told.textContent = wanted.length || dated ? `${listed} rows, ${shown} panels of ${found.length} vehicles` : "";
  }
  bar.addEventListener("input", update);
  if (vehicles.length) main.prepend(bar);
})();
