"use strict";
// What the page holds: JSON, and bytes that were deflated and written as base 64.

function jsonOf(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

function bytesOf(id) {
  const text = document.getElementById(id).textContent;
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Reads arrays one after the other.
class Planes {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  // Numbers whose differences, folded, stand in planes of their bytes.
  numbers(count, width) {
    const out = new Uint32Array(count);
    for (let i = 0, last = 0; i < count; i++) {
      let step = 0;
      for (let byte = 0; byte < width; byte++) step |= this.bytes[this.at + byte * count + i] << (8 * byte);
      last = (last + ((step >>> 1) ^ -(step & 1))) >>> 0;
      out[i] = last;
    }
    this.at += count * width;
    return out;
  }

  // Bytes that stand as differences.
  plane(count) {
    const out = new Uint8Array(count);
    for (let i = 0, last = 0; i < count; i++) out[i] = last = (last + this.bytes[this.at + i]) & 255;
    this.at += count;
    return out;
  }
}

// The surface: positions in mm, triangles, normals, and of each field its bytes.
async function readSurface(index) {
  const planes = new Planes(await inflate(bytesOf("surface-data")));
  const { vertices, quads } = index;
  const positions = new Float32Array(3 * vertices);
  for (let axis = 0; axis < 3; axis++) {
    const numbers = planes.numbers(vertices, 3);
    for (let i = 0; i < vertices; i++) positions[3 * i + axis] = index.low[axis] + index.step[axis] * numbers[i];
  }
  const corners = [0, 1, 2, 3].map(() => planes.numbers(quads, 4));
  const triangles = new Uint32Array(6 * quads);
  for (let i = 0; i < quads; i++) {
    const [a, b, c, d] = corners.map((corner) => corner[i]);
    triangles.set([a, b, c, a, c, d], 6 * i);
  }
  const fields = index.fields.map((field) => {
    const channels = (field.quantity ? [0] : [0, 1, 2]).map(() => planes.plane(vertices));
    return { ...field, channels };
  });
  return { ...index, positions, triangles, normals: normalsOf(positions, triangles), fields };
}

// Mean directions of the triangles at each vertex, as signed bytes with one to spare.
function normalsOf(positions, triangles) {
  const sums = new Float32Array(positions.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const ux = positions[b] - positions[a], uy = positions[b + 1] - positions[a + 1], uz = positions[b + 2] - positions[a + 2];
    const vx = positions[c] - positions[a], vy = positions[c + 1] - positions[a + 1], vz = positions[c + 2] - positions[a + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    for (const at of [a, b, c]) {
      sums[at] += nx;
      sums[at + 1] += ny;
      sums[at + 2] += nz;
    }
  }
  const out = new Int8Array((positions.length / 3) * 4);
  for (let i = 0; i < positions.length / 3; i++) {
    const length = Math.hypot(sums[3 * i], sums[3 * i + 1], sums[3 * i + 2]) || 1;
    for (let axis = 0; axis < 3; axis++) out[4 * i + axis] = Math.round((127 * sums[3 * i + axis]) / length);
  }
  return out;
}
