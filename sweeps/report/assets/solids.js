"use strict";
// A small painter's-algorithm renderer on a 2-D canvas: solids, wires and points, turned by
// dragging or by the arrow keys. Coordinates are metres, z up.
class Solids {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = -0.6;
    this.tilt = 0.35;
    this.zoom = 1;
    this.middle = [0, 0, 0];
    this.reach = 0.1;
    this.things = [];
    this.wanted = false;
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      this.from = [event.clientX, event.clientY];
    });
    canvas.addEventListener("pointermove", event => {
      if (!this.from) return;
      this.turn += (event.clientX - this.from[0]) * 0.01;
      this.tilt = clamp(this.tilt + (event.clientY - this.from[1]) * 0.01);
      this.from = [event.clientX, event.clientY];
      this.draw();
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, () => { this.from = null; });
    canvas.addEventListener("keydown", event => {
      const moves = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1],
        ArrowDown: [0, -0.1]};
      if (event.key in moves) {
        this.turn += moves[event.key][0];
        this.tilt = clamp(this.tilt + moves[event.key][1]);
      } else if (event.key === "+" || event.key === "=") this.zoom *= 1.15;
      else if (event.key === "-") this.zoom /= 1.15;
      else return;
      event.preventDefault();
      this.draw();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }

  // things: {points: Float32Array, faces: [[i, j, k, ...]], colour or a tint for each face,
  // solid | wire | dots, radius}
  show(things, frame = null) {
    this.things = things;
    if (frame) [this.middle, this.reach] = frame;
    this.draw();
  }

  draw() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => { this.wanted = false; this.paint(); });
  }

  paint() {
    const {canvas} = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const tint = name => style.getPropertyValue(name).trim();
    const [ct, st, cp, sp] = [Math.cos(this.turn), Math.sin(this.turn), Math.cos(this.tilt),
      Math.sin(this.tilt)];
    const scale = this.zoom * 0.45 * Math.min(width, height) / this.reach;
    const [mx, my, mz] = this.middle;
    const look = points => {  // to right, up and towards the eye
      const out = new Float32Array(points.length);
      for (let n = 0; n < points.length; n += 3) {
        const x = points[n] - mx, y = points[n + 1] - my, z = points[n + 2] - mz;
        const across = ct * x - st * y, along = st * x + ct * y;
        out[n] = width / 2 + scale * across;
        out[n + 1] = height / 2 - scale * (cp * z + sp * along);
        out[n + 2] = scale * (sp * z - cp * along);
      }
      return out;
    };
    const marks = [];
    for (const thing of this.things) {
      const at = look(thing.points);
      const colour = rgb(tint(thing.colour));
      if (thing.dots) {
        for (let n = 0; n < at.length; n += 3)
          marks.push({depth: at[n + 2] + 2, dot: [at[n], at[n + 1]], colour,
            radius: thing.radius ? thing.radius * scale : 4});
        continue;
      }
      if (thing.strokes) {
        for (const [i, j, radius] of thing.strokes)
          marks.push({depth: (at[3 * i + 2] + at[3 * j + 2]) / 2, colour,
            stroke: [at[3 * i], at[3 * i + 1], at[3 * j], at[3 * j + 1]],
            wide: Math.max(2 * radius * scale, 1.5)});
        continue;
      }
      for (const [number, face] of thing.faces.entries()) {
        const [a, , c] = face, b = face[1], d = face[face.length - 1];
        const ux = at[3 * c] - at[3 * a], uy = at[3 * c + 1] - at[3 * a + 1];
        const uz = at[3 * c + 2] - at[3 * a + 2];
        const vx = at[3 * d] - at[3 * b], vy = at[3 * d + 1] - at[3 * b + 1];
        const vz = at[3 * d + 2] - at[3 * b + 2];
        const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
        const size = Math.hypot(nx, ny, nz) || 1;
        if (!thing.wire && nz >= 0) continue;  // screen y points down: facing has nz < 0
        let depth = 0;
        for (const k of face) depth += at[3 * k + 2] / face.length;
        const light = 0.55 + 0.45 * Math.max(0, (-0.3 * nx + 0.5 * ny - 0.8 * nz) / size);
        marks.push({depth, face, at, colour: thing.tints?.[number] ?? colour, light, wire: thing.wire, back: nz >= 0});
      }
    }
    marks.sort((p, q) => p.depth - q.depth);
    for (const mark of marks) {
      const {colour} = mark;
      pen.beginPath();
      if (mark.dot) {
        pen.arc(...mark.dot, mark.radius, 0, 2 * Math.PI);
        pen.fillStyle = css(colour, 1);
        pen.fill();
        continue;
      }
      if (mark.stroke) {
        pen.moveTo(mark.stroke[0], mark.stroke[1]);
        pen.lineTo(mark.stroke[2], mark.stroke[3]);
        pen.lineCap = "round";
        pen.lineWidth = mark.wide;
        pen.strokeStyle = css(colour, 1);
        pen.stroke();
        continue;
      }
      mark.face.forEach((k, n) => pen[n ? "lineTo" : "moveTo"](mark.at[3 * k], mark.at[3 * k + 1]));
      pen.closePath();
      pen.lineWidth = 0.7;
      if (mark.wire) {
        pen.strokeStyle = css(colour, mark.back ? 0.18 : 0.5);
      } else {
        const shaded = colour.map(c => c * mark.light);
        pen.fillStyle = pen.strokeStyle = css(shaded, 1);
        pen.fill();
      }
      pen.stroke();
    }
    canvas.dataset.painted = String(marks.length);
  }
}

const clamp = angle => Math.max(-1.5, Math.min(1.5, angle));
const rgb = hex => [1, 3, 5].map(n => parseInt(hex.slice(n, n + 2), 16));
const css = (colour, alpha) => `rgba(${colour.map(Math.round).join(",")},${alpha})`;

function bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
}

function metres(text) {
  return Float32Array.from(new Int16Array(bytes(text)), value => value * 1e-4);
}

function quads(text) {
  const numbers = new Uint16Array(bytes(text)), faces = [];
  for (let n = 0; n < numbers.length; n += 4) faces.push([...numbers.subarray(n, n + 4)]);
  return faces;
}

// Colours of bytes, from violet over green to yellow (viridis).
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function tints(text) {
  return Array.from(new Uint8Array(bytes(text)), value => {
    const place = Math.min(value / 255 * 4, 3.999), n = Math.floor(place);
    return SCALE[n].map((low, k) => low + (place - n) * (SCALE[n + 1][k] - low));
  });
}

function gridFaces(rows, columns) {
  const faces = [];
  for (let r = 0; r + 1 < rows; r += 1)
    for (let c = 0; c + 1 < columns; c += 1) {
      const n = r * columns + c;
      faces.push([n, n + columns, n + columns + 1, n + 1]);
    }
  return faces;
}

// What holds every point: the middle of the box and its half diagonal.
function frameOf(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  points.forEach((value, n) => {
    low[n % 3] = Math.min(low[n % 3], value);
    high[n % 3] = Math.max(high[n % 3], value);
  });
  return [low.map((v, n) => (v + high[n]) / 2), Math.hypot(...high.map((v, n) => v - low[n])) / 2];
}
