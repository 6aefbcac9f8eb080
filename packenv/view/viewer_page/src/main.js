// Wires the page: data → state → view and panel.
import { heightGradient } from './colours.js';
import { readScene } from './data.js';
import { Panel } from './panel.js';
import { Stage } from './stage.js';
import { State } from './state.js';

const PLAY_MS = 1250;
const LEGEND_TICKS = 5;
const FLAGS = ['planned', 'heightmap', 'xray', 'walls', 'sizes'];
const root = document.documentElement;
const $ = (id) => document.getElementById(id);

/** Say on the page what went wrong; the attribute is for whoever drives the page by program. */
function fail(error) {
  root.dataset.state = 'error';
  root.dataset.error = String(error?.message ?? error);
  $('message').hidden = false;
  $('message').textContent = `The plan cannot be shown: ${root.dataset.error}`;
}
window.addEventListener('error', (event) => fail(event.error ?? event.message));
window.addEventListener('unhandledrejection', (event) => fail(event.reason));

class Player {
  constructor(state) {
    this.state = state;
    this.timer = null;
  }

  toggle() {
    if (this.timer) this.stop();
    else this.start();
  }

  start() {
    if (this.state.step === this.state.steps) this.state.set({ step: 0 });
    const forward = () => {
      this.state.set({ step: this.state.step + 1 });
      if (this.state.step === this.state.steps) this.stop();
    };
    this.timer = setInterval(forward, PLAY_MS);
    this.tell(true);
    forward();
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    this.tell(false);
  }

  tell(playing) {
    $('play').classList.toggle('playing', playing);
    $('play').setAttribute('aria-label', playing ? 'Pause' : 'Play');
  }
}

function legend(highest) {
  $('legend-bar').style.background = heightGradient;
  for (let k = LEGEND_TICKS - 1; k >= 0; k--) {
    const tick = document.createElement('li');
    tick.textContent = ((highest * k) / (LEGEND_TICKS - 1)).toFixed(3);
    $('legend-ticks').append(tick);
  }
}

function listen(state, stage, player) {
  const go = (step) => {
    player.stop();
    state.set({ step });
  };
  $('previous').addEventListener('click', () => go(state.step - 1));
  $('next').addEventListener('click', () => go(state.step + 1));
  $('play').addEventListener('click', () => player.toggle());
  $('slider').addEventListener('input', () => go(Number($('slider').value)));
  for (const button of document.querySelectorAll('[data-view]')) {
    button.addEventListener('click', () => stage.look(button.dataset.view));
  }
  const toggle = (flag) => !$(`toggle-${flag}`).disabled && state.toggle(flag);
  for (const flag of FLAGS) $(`toggle-${flag}`).addEventListener('click', () => toggle(flag));
  const keys = {
    ArrowRight: () => go(state.step + 1),
    ArrowLeft: () => go(state.step - 1),
    Home: () => go(0),
    End: () => go(state.steps),
    h: () => toggle('heightmap'),
    p: () => toggle('planned'),
    x: () => toggle('xray'),
    w: () => toggle('walls'),
    d: () => toggle('sizes'),
    Escape: () => state.set({ select: null }),
    ' ': () => player.toggle(),
  };
  ['iso', 'top', 'front', 'side'].forEach((view, k) => { keys[String(k + 1)] = () => stage.look(view); });
  window.addEventListener('keydown', (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    // The slider moves by arrows on its own, and space presses the focused button.
    const own = event.target.closest?.('button, summary, input');
    if (!keys[name] || (own && (name === ' ' || (own === $('slider') && name.length > 1)))) return;
    event.preventDefault();
    keys[name]();
  });
  window.addEventListener('hashchange', () => {
    state.read();
    state.set({ ...state.values });
  });
}

async function start() {
  const data = await readScene();
  if (data.heightmap) {
    data.heightmap.highest = data.heightmap.maps.reduce((most, map) => map.reduce((a, b) => Math.max(a, b), most), 0);
    legend(data.heightmap.highest);
  }
  const state = new State(data.steps.length);
  if (!data.heightmap) state.values.heightmap = false;
  $('toggle-heightmap').disabled = !data.heightmap;
  // Without an execution what is shown is the plan.
  if (!data.executed) state.values.planned = false;
  $('toggle-planned').hidden = $('key-planned').hidden = !data.executed;
  $('toggle-planned').disabled = !data.executed;
  const panel = new Panel(data, state);
  let stage;
  try {
    stage = new Stage($('canvas'), $('labels'), data);
  } catch (error) {
    throw new Error(`this browser gives no 3D view (WebGL 2): ${error.message}`);
  }
  stage.onPick = (index) => {
    if (index === null) state.set({ select: null });
    else state.select(index);
  };
  const show = (_, before) => {
    panel.show(state);
    const forward = before && state.step === before.step + 1 ? state.step - 1 : null;
    stage.show(state, forward);
    for (const flag of FLAGS) {
      $(`toggle-${flag}`).setAttribute('aria-pressed', String(state.flag(flag)));
    }
    $('legend').hidden = !state.flag('heightmap');
  };
  state.onChange(show);
  listen(state, stage, new Player(state));
  show(state, null);
  stage.look(state.view);
  stage.frame(performance.now());
  root.dataset.state = root.dataset.error ? 'error' : 'ready';
}

start().catch(fail);
