// Turns meshes and heightmaps into what the graphics card draws.
import { BufferAttribute, BufferGeometry, Color } from 'three';
import { heightColour } from './colours.js';

const CREASE = Math.cos((38 * Math.PI) / 180);

/**
 * A mesh with smooth normals over curved faces and hard ones over creases. The attribute `outward` is
 * smooth everywhere: along it a mesh can be inflated without gaps.
 */
export function meshGeometry({ vertices, faces }) {
  const faceCount = faces.length / 3;
  const vertexCount = vertices.length / 3;
  const normals = new Float32Array(3 * faceCount); // length: twice the face's area
  const lengths = new Float32Array(faceCount);
  const outward = new Float32Array(3 * vertexCount);
  const start = new Uint32Array(vertexCount + 1);
  for (let f = 0; f < faceCount; f++) {
    const [a, b, c] = [3 * faces[3 * f], 3 * faces[3 * f + 1], 3 * faces[3 * f + 2]];
    const [ux, uy, uz] = [vertices[b] - vertices[a], vertices[b + 1] - vertices[a + 1], vertices[b + 2] - vertices[a + 2]];
    const [vx, vy, vz] = [vertices[c] - vertices[a], vertices[c + 1] - vertices[a + 1], vertices[c + 2] - vertices[a + 2]];
    const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    normals.set(n, 3 * f);
    lengths[f] = Math.hypot(...n) || 1;
    for (const at of [a, b, c]) {
      start[at / 3 + 1]++;
      for (let k = 0; k < 3; k++) outward[at + k] += n[k];
    }
  }
  for (let i = 0; i < vertexCount; i++) {
    start[i + 1] += start[i];
    const length = Math.hypot(outward[3 * i], outward[3 * i + 1], outward[3 * i + 2]) || 1;
    for (let k = 0; k < 3; k++) outward[3 * i + k] /= length;
  }
  const fill = start.slice(0, vertexCount);
  const around = new Uint32Array(faces.length);
  for (let corner = 0; corner < faces.length; corner++) around[fill[faces[corner]]++] = Math.floor(corner / 3);

  const position = new Float32Array(3 * faces.length);
  const normal = new Float32Array(3 * faces.length);
  const inflate = new Float32Array(3 * faces.length);
  for (let corner = 0; corner < faces.length; corner++) {
    const vertex = faces[corner];
    const own = 3 * Math.floor(corner / 3);
    let [x, y, z] = [0, 0, 0];
    for (let at = start[vertex]; at < start[vertex + 1]; at++) {
      const other = 3 * around[at];
      const dot = normals[own] * normals[other] + normals[own + 1] * normals[other + 1] + normals[own + 2] * normals[other + 2];
      if (dot >= CREASE * lengths[own / 3] * lengths[around[at]]) {
        x += normals[other];
        y += normals[other + 1];
        z += normals[other + 2];
      }
    }
    const length = Math.hypot(x, y, z) || 1;
    normal.set([x / length, y / length, z / length], 3 * corner);
    position.set(vertices.subarray(3 * vertex, 3 * vertex + 3), 3 * corner);
    inflate.set(outward.subarray(3 * vertex, 3 * vertex + 3), 3 * corner);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(position, 3));
  geometry.setAttribute('normal', new BufferAttribute(normal, 3));
  geometry.setAttribute('outward', new BufferAttribute(inflate, 3));
  return geometry;
}

/** A heightmap as columns: a flat top for every cell, walls where neighbours differ. */
export function heightmapGeometry({ nx, ny, cellSize }, heights, highest) {
  const flat = 1e-5;
  const at = (i, j) => (i < 0 || j < 0 || i >= nx || j >= ny ? 0 : heights[i * ny + j]);
  let quads = nx * ny;
  for (let i = 0; i <= nx; i++) {
    for (let j = 0; j <= ny; j++) {
      if (j < ny && Math.abs(at(i, j) - at(i - 1, j)) > flat) quads++;
      if (i < nx && Math.abs(at(i, j) - at(i, j - 1)) > flat) quads++;
    }
  }
  const position = new Float32Array(12 * quads);
  const normal = new Int8Array(12 * quads);
  const colour = new Float32Array(12 * quads);
  const index = new Uint32Array(6 * quads);
  const tint = new Color();
  let quad = 0;
  const add = (corners, direction, height) => {
    tint.setRGB(...heightColour(highest > 0 ? height / highest : 0), 'srgb');
    for (let k = 0; k < 4; k++) {
      position.set(corners[k], 12 * quad + 3 * k);
      normal.set(direction, 12 * quad + 3 * k);
      colour.set([tint.r, tint.g, tint.b], 12 * quad + 3 * k);
    }
    index.set([0, 1, 2, 0, 2, 3].map((k) => 4 * quad + k), 6 * quad);
    quad++;
  };
  for (let i = 0; i <= nx; i++) {
    for (let j = 0; j <= ny; j++) {
      const [x, y, h] = [i * cellSize, j * cellSize, at(i, j)];
      const [x1, y1] = [x + cellSize, y + cellSize];
      if (i < nx && j < ny) add([[x, y, h], [x1, y, h], [x1, y1, h], [x, y1, h]], [0, 0, 127], h);
      const [left, below] = [at(i - 1, j), at(i, j - 1)];
      if (j < ny && Math.abs(h - left) > flat) {
        const wall = [[x, y, left], [x, y, h], [x, y1, h], [x, y1, left]];
        add(wall, [h > left ? -127 : 127, 0, 0], Math.max(h, left));
      }
      if (i < nx && Math.abs(h - below) > flat) {
        const wall = [[x, y, below], [x1, y, below], [x1, y, h], [x, y, h]];
        add(wall, [0, h > below ? -127 : 127, 0], Math.max(h, below));
      }
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(position, 3));
  geometry.setAttribute('normal', new BufferAttribute(normal, 3, true));
  geometry.setAttribute('color', new BufferAttribute(colour, 3));
  geometry.setIndex(new BufferAttribute(index, 1));
  return geometry;
}
