// The 3D view. It draws on demand: an idle page costs nothing.
import {
  AmbientLight,
  BackSide,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  DoubleSide,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  MeshStandardMaterial,
  PCFShadowMap,
  PerspectiveCamera,
  PlaneGeometry,
  Raycaster,
  Scene,
  ShadowMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { heightmapGeometry, meshGeometry } from './geometry.js';

const VIEWS = {
  iso: [0.62, -1, 0.72],
  top: [0, -0.001, 1],
  front: [0, -1, 0.12],
  side: [1, 0, 0.12],
};
const DESCENT_MS = 750;
const CLICK_PX = 5;

export class Stage {
  constructor(canvas, labels, data) {
    this.data = data;
    this.canvas = canvas;
    this.size = new Vector3(...data.container.size);
    this.centre = this.size.clone().multiplyScalar(0.5);
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, this.size.length() / 50, this.size.length() * 30);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.minDistance = this.size.length() / 8;
    this.controls.maxDistance = this.size.length() * 8;
    this.controls.addEventListener('change', () => this.draw());
    this.controls.addEventListener('start', () => { this.moved = true; });
    this.calm = window.matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.descent = null;
    this.moved = false;
    this.view = 'iso';

    this.addLights();
    this.addContainer();
    this.addItems();
    this.addLabels(labels);
    this.heightmap = null;
    this.heightmapKey = null;
    this.addPicking();
    this.readTheme();
    window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => {
      this.readTheme();
      this.draw();
    });
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  addLights() {
    this.scene.add(new HemisphereLight('#ffffff', '#a79f96', 1.5), new AmbientLight('#ffffff', 0.35));
    const key = new DirectionalLight('#fff6ea', 2.3);
    const reach = this.size.length();
    key.position.copy(this.centre).add(new Vector3(0.45, -0.6, 1.5).multiplyScalar(reach));
    key.target.position.copy(this.centre);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    Object.assign(key.shadow.camera, { left: -reach * 0.6, right: reach * 0.6, top: reach * 0.6, bottom: -reach * 0.6, near: 0.1 * reach, far: 4 * reach });
    key.shadow.normalBias = 0.004 * reach;
    key.shadow.radius = 3;
    const fill = new DirectionalLight('#dfe9ff', 0.7);
    fill.position.copy(this.centre).add(new Vector3(-1.2, -0.4, 0.5).multiplyScalar(reach));
    fill.target.position.copy(this.centre);
    this.scene.add(key, key.target, fill, fill.target);
  }

  addContainer() {
    const { x, y, z } = this.size;
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => [bits & 1 ? x : 0, bits & 2 ? y : 0, bits & 4 ? z : 0]);
    this.corners = corners.map((corner) => new Vector3(...corner));
    const edges = [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]];
    const points = new Float32Array(edges.flat().flatMap((corner) => corners[corner]));
    const geometry = new BufferGeometry().setAttribute('position', new BufferAttribute(points, 3));
    this.edges = new LineSegments(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.85 }));
    // Only the faces that look away from the camera are filled, so the front is always open to the eye.
    this.walls = new Mesh(
      new BoxGeometry(x, y, z).translate(x / 2, y / 2, z / 2),
      new MeshBasicMaterial({ side: BackSide, transparent: true, opacity: 0.1, depthWrite: false }),
    );
    this.walls.renderOrder = -2;
    const floor = new PlaneGeometry(x, y).translate(x / 2, y / 2, 0);
    this.floor = new Mesh(floor, new MeshBasicMaterial({ transparent: true, opacity: 0.12, side: DoubleSide, depthWrite: false }));
    this.floor.renderOrder = -1;
    this.shade = new Mesh(floor.clone().translate(0, 0, 1e-4 * this.size.length()), new ShadowMaterial({ opacity: 0.3 }));
    this.shade.receiveShadow = true;
    this.scene.add(this.edges, this.walls, this.floor, this.shade);
  }

  addItems() {
    const geometries = this.data.meshes.map(meshGeometry);
    this.items = this.data.steps.map((step, index) => {
      const material = new MeshStandardMaterial({ color: step.colour, roughness: 0.72, metalness: 0 });
      const solid = new Mesh(geometries[step.mesh], material);
      solid.castShadow = true;
      solid.receiveShadow = true;
      const outline = new Mesh(geometries[step.mesh], this.outlineMaterial());
      const pose = (rows) => new Matrix4().fromArray([...rows, 0, 0, 0, 1]).transpose();
      const planned = pose(step.matrix);
      for (const mesh of [solid, outline]) {
        mesh.matrixAutoUpdate = false;
        mesh.matrix.copy(step.measured ? pose(step.measured) : planned);
      }
      solid.userData.index = index;
      const group = new Group();
      group.add(solid, outline);
      this.scene.add(group);
      const ghost = this.data.executed ? this.ghost(geometries[step.mesh], step.colour, planned) : null;
      // After an execution, what is not measured was not placed: it is nowhere but in the plan.
      const absent = this.data.executed && !step.measured;
      return { group, solid, outline, ghost, absent, lift: this.size.z * 1.08 - step.corner[2] };
    });
  }

  /** Where the plan has an item: its colour, see-through. */
  ghost(geometry, colour, pose) {
    const material = new MeshStandardMaterial({ color: colour, roughness: 0.9, transparent: true, opacity: 0.28, depthWrite: false });
    const mesh = new Mesh(geometry, material);
    mesh.matrixAutoUpdate = false;
    mesh.matrix.copy(pose);
    mesh.visible = false;
    this.scene.add(mesh);
    return mesh;
  }

  outlineMaterial() {
    if (!this.outlineShared) {
      this.outlineShared = new MeshBasicMaterial({ side: BackSide });
      const width = (0.0032 * this.size.length()).toFixed(6);
      this.outlineShared.onBeforeCompile = (shader) => {
        shader.vertexShader = `attribute vec3 outward;\n${shader.vertexShader}`.replace(
          '#include <begin_vertex>',
          `vec3 transformed = position + outward * ${width};`,
        );
      };
    }
    return this.outlineShared;
  }

  addLabels(host) {
    this.labels = ['x', 'y', 'z'].map((axis) => {
      const label = document.createElement('span');
      const metres = this.size[axis].toFixed(3).replace(/0$/, '');
      label.textContent = `${{ x: 'length x', y: 'width y', z: 'height z' }[axis]} ${metres} m`;
      host.append(label);
      return label;
    });
  }

  addPicking() {
    let down = null;
    this.canvas.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
    this.canvas.addEventListener('pointerup', (event) => {
      if (!down || event.button !== 0 || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK_PX) return;
      const box = this.canvas.getBoundingClientRect();
      const spot = new Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
      const ray = new Raycaster();
      ray.setFromCamera(spot, this.camera);
      const shown = this.items.filter(({ group, solid }) => group.visible && solid.visible).map(({ solid }) => solid);
      const hit = ray.intersectObjects(shown, false)[0];
      this.onPick?.(hit ? hit.object.userData.index : null);
    });
  }

  readTheme() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => new Color(style.getPropertyValue(name).trim());
    this.edges.material.color = colour('--edge');
    this.walls.material.color = colour('--edge');
    this.floor.material.color = colour('--edge');
    this.outlineMaterial().color = colour('--accent');
  }

  /** Look from one of the named sides at the whole container. */
  look(view) {
    this.view = view in VIEWS ? view : 'iso';
    this.moved = false;
    const outward = new Vector3(...VIEWS[this.view]).normalize();
    const right = new Vector3(0, 0, 1).cross(outward).normalize();
    const upward = outward.clone().cross(right);
    const tall = Math.tan((this.camera.fov * Math.PI) / 360);
    // The smallest distance from which all corners are inside the frame, and the shift that centres them.
    const frame = (axis, slope) => {
      let [high, low] = [-Infinity, -Infinity];
      for (const corner of this.corners) {
        const spot = corner.clone().sub(this.centre);
        const [across, near] = [spot.dot(axis), spot.dot(outward)];
        high = Math.max(high, across + slope * near);
        low = Math.max(low, -across + slope * near);
      }
      return { distance: (high + low) / (2 * slope), shift: (high - low) / 2 };
    };
    // The toolbar and the player cover some of the height.
    const covered = Math.min(0.45, 150 / Math.max(1, this.canvas.clientHeight));
    const wide = frame(right, tall * this.camera.aspect * 0.86);
    const high = frame(upward, tall * (1 - covered));
    const target = this.centre.clone().addScaledVector(right, wide.shift).addScaledVector(upward, high.shift);
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(outward, Math.max(wide.distance, high.distance));
    this.controls.update();
    this.draw();
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    if (this.moved) this.draw();
    else this.look(this.view);
  }

  /** Show a state; `descend` is the index of an item that comes down from above the rim, or null. */
  show(state, descend = null) {
    const heights = state.flag('heightmap') && this.data.heightmap;
    const [xray, focus] = [state.flag('xray'), state.focus];
    this.items.forEach(({ group, solid, outline, ghost, absent }, index) => {
      const shown = index < state.step && !state.hidden.has(index);
      group.visible = shown && !absent;
      if (ghost) ghost.visible = shown && state.flag('planned') && !heights;
      group.position.z = 0;
      const clear = xray && !heights && index !== focus;
      const { material } = solid;
      if (material.transparent !== clear) {
        material.transparent = clear;
        material.depthWrite = !clear;
        material.opacity = clear ? 0.2 : 1;
        material.needsUpdate = true;
      }
      solid.castShadow = !clear && !heights;
      outline.visible = index === focus && !heights;
      // Under an opaque heightmap an item could only poke out by rounding.
      solid.visible = !heights || xray;
    });
    this.edges.visible = this.walls.visible = state.flag('walls');
    this.sizes = state.flag('sizes');
    this.floor.visible = this.shade.visible = !heights; // the heightmap has a floor of its own
    this.showHeightmap(heights ? state.step : null, xray);
    const moving = descend !== null && !this.calm && !heights && this.items[descend].group.visible;
    this.descent = moving ? { item: this.items[descend], since: null } : null;
    if (moving) this.descent.item.group.position.z = this.descent.item.lift;
    this.draw();
  }

  showHeightmap(step, seeThrough) {
    const key = step === null ? null : `${step} ${seeThrough}`;
    if (key === this.heightmapKey) return;
    this.heightmapKey = key;
    if (this.heightmap) {
      this.scene.remove(this.heightmap);
      this.heightmap.geometry.dispose();
      this.heightmap.material.dispose();
      this.heightmap = null;
    }
    if (step === null) return;
    const maps = this.data.heightmap;
    const heights = step > 0 ? maps.maps[step - 1] : new Float32Array(maps.nx * maps.ny);
    const material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide, transparent: seeThrough, opacity: seeThrough ? 0.45 : 1, polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -4 });
    this.heightmap = new Mesh(heightmapGeometry(maps, heights, maps.highest), material);
    this.scene.add(this.heightmap);
  }

  placeLabels() {
    const { x, y, z } = this.size;
    const eye = this.camera.position;
    const [nearX, nearY] = [eye.x > x / 2 ? x : 0, eye.y > y / 2 ? y : 0];
    // The upright edge that stands at the side of the picture: of the two beside the nearest one, the right one.
    const beside = [new Vector3(nearX, y - nearY, z / 2), new Vector3(x - nearX, nearY, z / 2)];
    const side = beside.reduce((a, b) => (a.clone().project(this.camera).x > b.clone().project(this.camera).x ? a : b));
    const spots = [new Vector3(x / 2, nearY, 0), new Vector3(nearX, y / 2, 0), side];
    const [across, down] = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    const middle = this.centre.clone().project(this.camera);
    this.labels.forEach((label, k) => {
      const spot = spots[k].project(this.camera);
      label.hidden = !this.sizes || spot.z > 1;
      if (label.hidden) return;
      const away = new Vector2((spot.x - middle.x) * across, (spot.y - middle.y) * down);
      away.setLength(away.length() > 1 ? 10 : 0);
      const room = label.offsetWidth;
      const left = (spot.x + 1) * across + away.x;
      const top = (1 - spot.y) * down - away.y;
      // Towards the outside of the picture the label stands wholly beside its edge, not over it.
      const start = left - room / 2 + (room * away.x) / 20;
      const inside = Math.max(2, Math.min(2 * across - room - 2, start));
      const lean = (-50 - 5 * away.y).toFixed(1);
      label.style.transform = `translate(${inside.toFixed(1)}px, ${top.toFixed(1)}px) translateY(${lean}%)`;
    });
  }

  draw() {
    if (!this.pending) this.pending = requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = 0;
    if (this.descent) {
      this.descent.since ??= now;
      const share = Math.min(1, (now - this.descent.since) / DESCENT_MS);
      this.descent.item.group.position.z = this.descent.item.lift * (1 - share) ** 2;
      if (share === 1) this.descent = null;
      this.draw();
    }
    this.renderer.render(this.scene, this.camera);
    this.placeLabels();
  }
}
