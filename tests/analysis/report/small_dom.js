// As much of a browser's document as charts.js uses, over the elements that a test parsed.
function Node(tag, attributes, children, text) {
  this.tag = tag; this.attributes = attributes; this.children = []; this.text = text;
  this.style = {}; this.listeners = {}; this.parentNode = null;
  this.hidden = "hidden" in attributes; this.checked = "checked" in attributes;
  this.open = "open" in attributes; this.viewBox = { baseVal: { width: 400 } };
  children.forEach(this.appendChild, this);
}
Node.prototype = {
  get className() { return this.attributes["class"] || ""; },
  set className(value) { this.attributes["class"] = value; },
  get textContent() { return this.text + this.children.map(function (c) { return c.textContent; }).join(" "); },
  set textContent(value) { this.children = []; this.text = String(value); },
  get classList() {
    var node = this;
    function names() { return node.className.split(" ").filter(Boolean); }
    return { toggle: function (name, on) {
      var others = names().filter(function (n) { return n !== name; });
      node.className = others.concat(on ? [name] : []).join(" ");
    } };
  },
  appendChild: function (child) { child.parentNode = this; this.children.push(child); return child; },
  getAttribute: function (name) { return name in this.attributes ? this.attributes[name] : null; },
  setAttribute: function (name, value) { this.attributes[name] = String(value); },
  getBoundingClientRect: function () { return { left: 0, width: 400 }; },
  addEventListener: function (kind, listener) { (this.listeners[kind] = this.listeners[kind] || []).push(listener); },
  fire: function (kind, event) {
    (this.listeners[kind] || []).forEach(function (listener) { listener(event || {}); });
  },
  matches: function (selector) {
    var node = this, parts = selector.match(/:not\([^)]*\)|\[[^\]]*\]|\.[\w-]+|[\w-]+/g);
    return parts.every(function (part) {
      if (part.indexOf(":not(") === 0) return !node.matches(part.slice(5, -1));
      if (part[0] === "[") return part.slice(1, -1) === "open" ? node.open : part.slice(1, -1) in node.attributes;
      if (part[0] === ".") return (" " + node.className + " ").indexOf(" " + part.slice(1) + " ") >= 0;
      return node.tag === part;
    });
  },
  querySelectorAll: function (selector) {
    return this.children.reduce(function (found, child) {
      return found.concat(child.matches(selector) ? [child] : [], child.querySelectorAll(selector));
    }, []);
  },
  querySelector: function (selector) { return this.querySelectorAll(selector)[0]; }
};
function build(plain) { return new Node(plain[0], plain[1], plain[2].map(build), plain[3]); }
var document = build(PAGE), window = new Node("window", {}, [], "");
document.createElement = function (tag) { return new Node(tag, {}, [], ""); };
document.createElementNS = function (space, tag) { return new Node(tag, {}, [], ""); };
