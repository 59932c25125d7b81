"use strict";
(function () {
  var PANEL_WIDTH = 400;

  // What a screen reader says of a cell, the pointer shows.
  document.querySelectorAll(".still [aria-label]").forEach(function (mark) {
    var title = document.createElementNS(mark.namespaceURI, "title");
    title.textContent = mark.getAttribute("aria-label");
    mark.append(title);
  });

  // A drawing becomes a chart when it comes into view; "ast": without eval, which the page forbids.
  function draw(figure) {
    var plot = figure.querySelector(".plot"), view = document.createElement("div");
    var spec = JSON.parse(figure.querySelector("script").textContent);
    spec.columns = Math.max(1, Math.min(spec.columns, Math.round(plot.clientWidth / PANEL_WIDTH)));
    spec.config.legend.columns = spec.usermeta.legend_columns[spec.columns - 1];
    window.vegaEmbed(view, spec, { actions: false, ast: true, renderer: "svg" }).then(function () {
      plot.append(view);
      plot.classList.add("live");
    });
  }
  var seen = new IntersectionObserver(function (entries) {
    entries.forEach(function (entry) {
      if (!entry.isIntersecting) return;
      seen.unobserve(entry.target);
      draw(entry.target);
    });
  });
  window.addEventListener("load", function () {
    document.querySelectorAll("figure.chart").forEach(function (figure) { seen.observe(figure); });
  });
})();
