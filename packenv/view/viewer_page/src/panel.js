// Lists and figures beside the view. Every name reaches the page as text, never as markup.

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const eyeIcon = () => document.getElementById('eye-icon').content.cloneNode(true);

function words(value) {
  if (value === null || value === undefined) return '–';
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  if (typeof value === 'number') return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(5)));
  return String(value);
}

const label = (key) => (/^[a-z0-9_]+$/.test(key) ? key.replaceAll('_', ' ') : key);

/** A table of figures. A value may again be a table or a list; notes say what a label means. */
export function figures(record, notes = {}) {
  const list = element('dl', { class: 'figures' });
  for (const [key, value] of Object.entries(record)) {
    const note = Object.hasOwn(notes, key) ? { title: notes[key] } : {};
    if (value !== null && typeof value === 'object') {
      const plain = Array.isArray(value) && value.every((part) => part === null || typeof part !== 'object');
      if (plain) {
        list.append(element('dt', note, label(key)), element('dd', {}, value.map(words).join(', ') || '–'));
      } else {
        list.append(element('dt', { class: 'heading' }, label(key)), element('dd', { class: 'wide' }, figures(value)));
      }
    } else {
      list.append(element('dt', note, label(key)), element('dd', {}, words(value)));
    }
  }
  return list;
}

export class Panel {
  constructor(data, state) {
    this.data = data;
    this.rows = data.steps.map((step, index) => this.row(step, index, state));
    const $ = (id) => document.getElementById(id);
    $('items').append(...this.rows.map(({ host }) => host));
    $('items-count').textContent = `${data.steps.length} placed`;
    for (const [term, value] of data.summary) {
      const note = Object.hasOwn(data.notes, term) ? { title: data.notes[term] } : {};
      $('summary').append(element('div', note, element('dt', {}, term), element('dd', {}, value)));
    }
    $('leftovers-section').hidden = data.leftovers.length === 0;
    $('leftovers-count').textContent = String(data.leftover_count);
    for (const record of data.leftovers) {
      const reason = element('span', { class: 'reason' }, label(record.reason.replaceAll('-', '_')));
      $('leftovers').append(
        element('li', {}, element('strong', {}, record.name), reason, element('p', {}, record.detail)),
      );
    }
    for (const part of ['metrics', 'settings']) {
      $(`${part}-section`).hidden = Object.keys(data[part]).length === 0;
      $(part).append(figures(data[part]));
    }
    this.caption = $('caption');
    this.slider = $('slider');
    this.slider.max = String(data.steps.length);
    this.buttons = { previous: $('previous'), next: $('next') };
  }

  row(step, index, state) {
    const swatch = element('span', { class: 'swatch' });
    swatch.style.background = step.colour;
    const select = element(
      'button',
      { type: 'button', class: 'select' },
      element('span', { class: 'number' }, String(index + 1)),
      swatch,
      element('span', { class: 'name' }, step.name),
    );
    if (step.limits.length) select.lastChild.append(element('span', { class: 'limits' }, step.limits.join(' · ')));
    select.title = [step.name, ...step.limits].join(' · ');
    select.addEventListener('click', () => state.select(index));
    const eye = element('button', { type: 'button', class: 'eye' }, eyeIcon());
    eye.addEventListener('click', () => state.toggleHidden(index));
    const host = element('li', {}, element('div', { class: 'row' }, select, eye));
    return { host, select, eye, detail: null };
  }

  show(state) {
    const { focus } = state;
    this.rows.forEach((row, index) => {
      const [current, hidden] = [index === focus, state.hidden.has(index)];
      row.host.classList.toggle('current', current);
      row.host.classList.toggle('later', index >= state.step);
      row.host.classList.toggle('hidden-item', hidden);
      row.select.setAttribute('aria-expanded', String(current));
      const { name } = this.data.steps[index];
      row.eye.setAttribute('aria-label', `${hidden ? 'Show' : 'Hide'} ${name}`);
      row.eye.title = hidden ? 'Show' : 'Hide';
      if (current && !row.detail) {
        row.detail = figures(this.data.steps[index].figures, this.data.notes);
        row.host.append(row.detail);
      } else if (!current && row.detail) {
        row.detail.remove();
        row.detail = null;
      }
    });
    // Only the list moves: scrollIntoView would move the whole page on a phone, away from the view.
    const scroller = this.rows[focus]?.host.closest('.panel');
    if (scroller && scroller.scrollHeight > scroller.clientHeight) {
      const [row, frame] = [this.rows[focus].host.getBoundingClientRect(), scroller.getBoundingClientRect()];
      if (row.top < frame.top) scroller.scrollTop += row.top - frame.top - 8;
      else if (row.bottom > frame.bottom) scroller.scrollTop += row.bottom - frame.bottom + 8;
    }
    const count = this.data.steps.length;
    this.slider.value = String(state.step);
    const last = state.step > 0 ? this.data.steps[state.step - 1].name : 'empty';
    const detail = element('span', { class: 'detail' }, ` · ${last}`);
    this.caption.replaceChildren(`Step ${state.step} of ${count}`, detail);
    this.slider.setAttribute('aria-valuetext', `Step ${state.step} of ${count}, ${last}`);
    this.buttons.previous.disabled = state.step === 0;
    this.buttons.next.disabled = state.step === count;
  }
}
