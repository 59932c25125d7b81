"use strict";
// Hovering and switching of the curves. The page is complete without it.
(function () {
  function nearest(values, wanted) {
    var best = 0;
    values.forEach(function (value, i) {
      if (Math.abs(value - wanted) < Math.abs(values[best] - wanted)) best = i;
    });
    return best;
  }

  function make(tag, text, parent, name) {
    var element = document.createElement(tag);
    element.textContent = text;
    if (name) element.className = name;
    parent.appendChild(element);
    return element;
  }

  function shows(chart, key) {
    var found = Array.prototype.filter.call(chart.querySelectorAll("[data-switch]"), function (box) {
      return box.getAttribute("data-switch") === key;
    });
    return !found.length || found[0].checked;
  }

  function format(one, i, unit) {
    var text = one.y[i].toFixed(1);
    if (one.spread) text += " ± " + one.spread[i].toFixed(1);
    return text + " " + unit;
  }

  function Panel(chart, panel) {
    this.chart = chart;
    this.svg = panel.querySelector("svg");
    this.box = panel.querySelector(".values");
    this.pointer = panel.querySelector(".pointer");
    this.data = JSON.parse(panel.querySelector("script").textContent);
    this.dots = this.data.series.map(function (one) {
      var dot = document.createElementNS("http://www.w3.org/2000/svg", "circle");
      dot.setAttribute("r", 3);
      dot.setAttribute("class", "dot " + one.style);
      this.svg.appendChild(dot);
      return dot;
    }, this);
    this.hide();
    this.listen();
  }

  Panel.prototype.visible = function () {
    return this.data.series.filter(function (one) { return shows(this.chart, one.key); }, this);
  };

  Panel.prototype.place = function (x) {
    var from = this.data.from, to = this.data.to;
    return from[0] + (x - from[1]) / (to[1] - from[1]) * (to[0] - from[0]);
  };

  Panel.prototype.value = function (event) {
    var frame = this.svg.getBoundingClientRect(), from = this.data.from, to = this.data.to;
    var at = (event.clientX - frame.left) / frame.width * this.svg.viewBox.baseVal.width;
    return from[1] + (at - from[0]) / (to[0] - from[0]) * (to[1] - from[1]);
  };

  Panel.prototype.hide = function () {
    this.box.hidden = true;
    this.pointer.style.display = "none";
    this.dots.forEach(function (dot) { dot.style.display = "none"; });
  };

  Panel.prototype.show = function (wanted) {
    var seen = this.visible();
    if (!seen.length) { this.hide(); return; }
    var x = seen[0].x[nearest(seen[0].x, wanted)], at = this.place(x);
    this.x = x;
    this.pointer.setAttribute("transform", "translate(" + at + " 0)");
    this.pointer.style.display = "";
    this.box.textContent = "";
    make("b", this.data.name + " " + x, this.box);
    var rows = [];
    this.data.series.forEach(function (one, n) {
      var i = nearest(one.x, x);
      this.dots[n].style.display = seen.indexOf(one) < 0 ? "none" : "";
      this.dots[n].setAttribute("cx", this.place(one.x[i]));
      this.dots[n].setAttribute("cy", one.at[i]);
      if (seen.indexOf(one) >= 0) rows.push([one.y[i], one, i]);
    }, this);
    rows.sort(function (a, b) { return b[0] - a[0]; });
    rows.forEach(function (row) { this.line(row[1], row[2], x); }, this);
    this.box.hidden = false;
    this.box.classList.toggle("left", at > (this.data.from[0] + this.data.to[0]) / 2);
  };

  Panel.prototype.line = function (one, i, x) {
    var row = make("div", "", this.box, one.style), paper = "";
    make("i", "", row);
    make("span", one.name, row);
    one.marks.forEach(function (mark) { if (Math.abs(mark[0] - x) < 0.5) paper = mark[1]; });
    make("span", format(one, i, this.data.unit) + (one.stars[i] ? " " + one.stars[i] : ""), row, "number");
    if (paper) make("div", paper, this.box, "paper");
  };

  Panel.prototype.listen = function () {
    var self = this, svg = this.svg;
    svg.addEventListener("pointermove", function (event) { self.show(self.value(event)); });
    svg.addEventListener("pointerdown", function (event) { self.show(self.value(event)); });
    svg.addEventListener("pointerleave", function () { self.hide(); });
    svg.addEventListener("blur", function () { self.hide(); });
    svg.addEventListener("keydown", function (event) {
      var step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], all = self.data.series[0].x;
      if (event.key === "Escape") self.hide();
      if (!step) return;
      event.preventDefault();
      var i = self.box.hidden ? all.length - 1 : nearest(all, self.x) + step;
      self.show(all[Math.min(Math.max(i, 0), all.length - 1)]);
    });
  };

  function each(root, selector, action) {
    Array.prototype.forEach.call(root.querySelectorAll(selector), action);
  }

  function listen(chart) {
    each(chart, ".panel", function (panel) { new Panel(chart, panel); });
    each(chart, "[data-switch]", function (box) {
      var key = box.getAttribute("data-switch");
      function update() {
        each(chart, "[data-series]", function (group) {
          if (group.getAttribute("data-series") === key) {
            group.style.display = box.checked ? "" : "none";
          }
        });
      }
      function fade(other) {
        each(chart, "[data-series]", function (group) {
          group.classList.toggle("faded", other && group.getAttribute("data-series") !== key);
        });
      }
      box.addEventListener("change", update);
      box.parentNode.addEventListener("pointerenter", function () { fade(box.checked); });
      box.parentNode.addEventListener("pointerleave", function () { fade(false); });
      update();  // A browser may restore switches that were off.
    });
  }

  each(document, "[data-chart]", listen);

  // Paper cannot unfold anything.
  var opened = [];
  window.addEventListener("beforeprint", function () {
    each(document, "details:not([open]):not(.long)", function (one) {
      one.open = true;
      opened.push(one);
    });
  });
  window.addEventListener("afterprint", function () {
    opened.forEach(function (one) { one.open = false; });
    opened = [];
  });
})();
