"use strict";
// Draws the figures of a page of the gallery; each stands as JSON beside its place.
(function () {
  const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"] };
  const shared = {
    font: { family: "system-ui, Segoe UI, Roboto, DejaVu Sans, sans-serif", size: 12, color: "#1b2530" },
    paper_bgcolor: "#fff",
  };
  document.querySelectorAll(".plotly-figure").forEach((box) => {
    const figure = JSON.parse(box.querySelector("script").textContent);
    Plotly.newPlot(box.firstElementChild, figure.data, Object.assign({}, shared, figure.layout), config);
  });
})();
