// Reads what the page carries: a JSON description and one deflated block of integer arrays.

/** Inflate the page's block of arrays. */
async function inflate(base64) {
  const text = atob(base64.trim());
  const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Undo the writer's coding: running differences, zigzag signs, four byte planes. */
function unpackIntegers(block, { offset, count }) {
  const values = new Int32Array(count);
  let running = 0;
  for (let i = 0; i < count; i++) {
    const at = offset + i;
    const zigzag =
      (block[at] | (block[at + count] << 8) | (block[at + 2 * count] << 16) | (block[at + 3 * count] << 24)) >>> 0;
    running += (zigzag >>> 1) ^ -(zigzag & 1);
    values[i] = running;
  }
  return values;
}

function readMesh(block, record) {
  const axes = record.vertices.map((array) => unpackIntegers(block, array));
  const count = axes[0].length;
  const vertices = new Float32Array(3 * count);
  axes.forEach((axis, k) => {
    for (let i = 0; i < count; i++) vertices[3 * i + k] = axis[i] * record.unit;
  });
  return { vertices, faces: unpackIntegers(block, record.faces) };
}

function readHeightmaps(block, record) {
  if (!record) return null;
  const cells = record.nx * record.ny;
  const changes = unpackIntegers(block, record.heights);
  const maps = [];
  const running = new Int32Array(cells);
  for (let step = 0; step * cells < changes.length; step++) {
    for (let i = 0; i < cells; i++) running[i] += changes[step * cells + i];
    maps.push(Float32Array.from(running, (value) => value * record.unit));
  }
  return { nx: record.nx, ny: record.ny, cellSize: record.cell_size, maps };
}

/** The whole scene, arrays included. */
export async function readScene() {
  const scene = JSON.parse(document.getElementById('scene-data').textContent);
  const block = await inflate(document.getElementById('scene-arrays').textContent);
  return {
    ...scene,
    meshes: scene.meshes.map((record) => readMesh(block, record)),
    heightmap: readHeightmaps(block, scene.heightmap),
  };
}
