"use strict";

// The obstacle fan: 72 sectors round the drone, nose up. Free is a calm plain area, unknown is hatched, an obstacle is a
// bright edge in the colour that its distance has in the depth picture, with its shadow behind.

const SVG = "http://www.w3.org/2000/svg";
const RADIUS = 100;

function element(name, attributes, parent) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (parent) parent.append(made);
  return made;
}

// Nearer distances get more room: the radius grows as the root of the distance.
function radius(metres, most) {
  return RADIUS * Math.sqrt(Math.min(1, Math.max(0, metres / most)));
}

function point(r, degrees) {
  const angle = degrees * Math.PI / 180;
  return `${(r * Math.sin(angle)).toFixed(2)} ${(-r * Math.cos(angle)).toFixed(2)}`;
}

function arc(r, from, to) {
  return `M${point(r, from)}A${r} ${r} 0 0 1 ${point(r, to)}`;
}

function wedge(inner, outer, from, to) {
  const hole = inner > 0 ? `L${point(inner, to)}A${inner} ${inner} 0 0 0 ${point(inner, from)}Z` : "L0 0Z";
  return `M${point(outer, from)}A${outer} ${outer} 0 0 1 ${point(outer, to)}${hole}`;
}

class Fan {
  constructor(svg, scale) {
    this.svg = svg;
    this.scale = scale;
    const hatch = element("pattern", { id: "hatch", width: 5, height: 5, patternUnits: "userSpaceOnUse",
                                       patternTransform: "rotate(45)" }, element("defs", {}, svg));
    element("rect", { width: 5, height: 5, fill: "#20252c" }, hatch);
    element("rect", { width: 0.9, height: 5, fill: "#454d58" }, hatch);
    this.sectors = element("g", { id: "sectors" }, svg);
    this.rings = element("g", {}, svg);
    element("path", { class: "drone", d: "M0 -5.5L3.8 4.5L0 2.4L-3.8 4.5Z" }, svg);
  }

  draw(fan) {
    if (this.most !== fan.max_m) this.drawRings(fan.max_m);
    const width = 360 / fan.sectors.length;
    const made = document.createDocumentFragment();
    fan.sectors.forEach((sector, index) => {
      const from = index * width - width / 2, to = from + width;
      this.drawSector(made, sector, from, to);
    });
    this.sectors.replaceChildren(made);
  }

  // What was drawn is old: nothing may look free any more.
  forget() {
    const count = this.sectors.childElementCount;
    this.draw({ max_m: this.most, sectors: Array.from({ length: count }, () => ({ kind: "unknown" })) });
  }

  drawSector(parent, sector, from, to) {
    const group = element("g", { "data-kind": sector.kind }, parent);
    if (sector.kind === "unknown") {
      element("path", { d: wedge(0, RADIUS, from, to), fill: "url(#hatch)" }, group);
      return;
    }
    if (sector.kind === "free") {
      element("path", { class: "free", d: wedge(0, RADIUS, from, to) }, group);
      return;
    }
    const r = radius(sector.m, this.most);
    element("path", { d: wedge(r, RADIUS, from, to), fill: "url(#hatch)" }, group);
    element("path", { class: "near", d: wedge(0, r, from, to) }, group);
    if (sector.kind === "clear") {
      element("path", { class: "clear-edge", d: arc(r, from, to) }, group);
      return;
    }
    const colour = this.colour(sector.m);
    element("path", { class: "behind", d: wedge(r, RADIUS, from, to), fill: colour }, group);
    element("path", { class: sector.old ? "edge old" : "edge", d: arc(r, from, to), stroke: colour }, group);
  }

  drawRings(most) {
    this.most = most;
    this.rings.replaceChildren();
    for (const turn of [0, 45, 90, 135]) {
      element("path", { class: "cross", d: `M${point(RADIUS, turn)}L${point(RADIUS, turn + 180)}` }, this.rings);
    }
    const steps = [2, 5, 10, 20, 50, 100, 200].filter((metres) => metres < most * 0.8 && metres >= most / 9);
    for (const metres of [...steps, most]) {
      const r = radius(metres, most);
      element("circle", { class: metres === most ? "outline" : "ring", r }, this.rings);
      const label = element("text", { x: 2, y: -r + (metres === most ? -3 : 7) }, this.rings);
      label.textContent = `${metres} m`;
    }
  }

  colour(metres) {
    const { near_m: near, far_m: far, colours } = this.scale;
    const share = Math.log(Math.min(far, Math.max(near, metres)) / near) / Math.log(far / near);
    // The darkest colours would be lost on this ground.
    return colours[Math.round(share * 0.72 * (colours.length - 1))];
  }
}

function nearest(fan) {
  let found = null;
  fan.sectors.forEach((sector, index) => {
    if (sector.kind === "obstacle" && (found === null || sector.m < found.m)) found = { m: sector.m, index };
  });
  return found;
}

function bearing(index, count) {
  const degrees = index * 360 / count;
  if (degrees === 0) return "straight ahead";
  if (degrees === 180) return "straight behind";
  return degrees < 180 ? `${degrees}° to the right` : `${360 - degrees}° to the left`;
}
