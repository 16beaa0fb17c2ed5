// The console's page: shows what /stream or, for a recording, /state tells, and posts commands.
'use strict';
const SURE_MS = 3000;
const SIGNS = { info: 'ℹ', warning: '▲', fault: '■' };
const VALUES = [
  ['outputs.compression_m', 'compression', 'mm', 1e3, 2], ['outputs.speed_m_s', 'nut speed', 'mm/s', 1e3, 2],
  ['outputs.voltage_v', 'motor voltage', 'V', 1, 2], ['motor_current.current_a', 'motor current', 'A', 1, 3],
  ['magnet_current.current_a', 'magnet current', 'A', 1, 3], ['outputs.winding_rise_k', 'winding rise', 'K', 1, 1],
  ['motor_current.supply_v', 'supply', 'V', 1, 2],
];
const STATES = [['switches.at_home', 'nut at home'], ['switches.latch_closed', 'lock closed'],
                ['outputs.magnet_on', 'magnet on']];
let fixed = null;
let hopsShown = '';

function get(id) { return document.getElementById(id); }
function words(text) { return String(text).replaceAll('_', ' '); }
function element(tag, text, cls) {
  const made = document.createElement(tag);
  made.textContent = text;
  if (cls) made.className = cls;
  return made;
}
function number(value, digits) { return value === null || value === undefined ? '–' : value.toFixed(digits); }
function plusMinus(q, scale) {
  if (!q) return '–';
  const sigma = scale * q.sigma;
  const digits = sigma > 0 ? Math.max(0, 1 - Math.floor(Math.log10(sigma))) : 3;
  return `${(scale * q.value).toFixed(digits)} ± ${sigma.toFixed(digits)}`;
}
function detail(value) {
  if (typeof value === 'number') return String(Number(value.toPrecision(4)));
  return typeof value === 'object' ? JSON.stringify(value) : words(value);
}
// A list is only touched when it changed: screen readers and scroll positions are left in peace.
function fill(id, items) {
  const list = get(id), sign = JSON.stringify(items);
  if (list.dataset.sign === sign) return;
  list.dataset.sign = sign;
  list.replaceChildren(...(items.length ? items.map(([text, cls]) => element('li', text, cls)) :
    [element('li', 'none yet', 'soft')]));
}

function showStates(state) {
  for (const item of document.querySelectorAll('#states li')) {
    if (item.dataset.phase === state.phase) item.setAttribute('aria-current', 'step');
    else item.removeAttribute('aria-current');
  }
  const text = words(state.phase || 'not heard yet').toUpperCase();
  if (get('phase').textContent !== text) get('phase').textContent = text;
  get('in-phase').textContent = state.phase ? `for ${state.in_phase_s.toFixed(1)} s` +
    (state.reason ? `, reason: ${words(state.reason)}` : '') : '';
  get('clock').textContent = `t = ${state.time_s.toFixed(1)} s, hop ${state.hop_index + 1}`;
  const loaded = state.loaded && state.phase;
  const danger = state.armed ? 'ARMED: keep clear. The spring can let go at any moment.' :
    loaded ? 'The spring may hold energy.' : state.phase ? 'Nothing is stored.' : '';
  if (get('danger').textContent !== danger) get('danger').textContent = danger;
  get('banner').className = state.armed ? 'armed' : loaded ? 'loaded' : '';
  document.body.classList.toggle('armed', state.armed);
  document.title = (state.armed ? '⚠ ARMED ' : '') + 'hopper console';
}

function showGauges(state) {
  const c = state.channels, energy = c['outputs.energy_used_j'], force = c['outputs.string_force_n'];
  get('energy').textContent = `${number(energy, 2)} J of ${fixed.limits.energy_j} J`;
  get('energy-meter').value = energy || 0;
  get('force').textContent = `${number(force, 0)} N of ${fixed.limits.force_n} N`;
  get('force-meter').value = force || 0;
  const rows = [];
  for (const [name, label, unit, scale, digits] of VALUES) {
    if (c[name] === null || c[name] === undefined) continue;
    rows.push(element('dt', label), element('dd', `${(scale * c[name]).toFixed(digits)} ${unit}`));
  }
  for (const [name, label] of STATES) {
    if (name in c) rows.push(element('dt', label), element('dd', c[name] ? 'yes' : 'no'));
  }
  get('values').replaceChildren(...rows);
}

function showLists(state) {
  fill('answers', state.answers.slice(-8).reverse().map(answer =>
    [`${answer.time_s.toFixed(1)} s  ${answer.words}`, answer.why && answer.why.length ? 'refused' : '']));
  fill('decisions', state.decisions.slice().reverse().map(each =>
    [`${each.time_s.toFixed(1)} s, hop ${each.hop_index + 1} at ${each.place}: ${each.sentence}`, '']));
  fill('events', state.events.slice().reverse().map(event => {
    const details = Object.entries(event).filter(([key]) => !['time_s', 'name', 'severity', 'sequence'].includes(key))
      .map(([key, value]) => `${words(key)} ${detail(value)}`);
    const text = fixed.words[event.name] || words(event.name);
    return [`${SIGNS[event.severity] || ''} ${event.severity} ${event.time_s.toFixed(1)} s  ${text}` +
            (details.length ? ` (${details.join(', ')})` : ''), event.severity];
  }));
  const sign = JSON.stringify(state.hops);
  if (sign === hopsShown) return;
  hopsShown = sign;
  get('hops').replaceChildren(...state.hops.map(hop => {
    const row = document.createElement('tr');
    row.append(...[hop.hop_index + 1, hop.place, hop.verdict, plusMinus(hop.energy_used_j, 1),
      plusMinus(hop.height_m, 1e3), plusMinus(hop.c3, 100)].map(text => element('td', text)));
    return row;
  }));
  drawBelief(state.hops);
}

function showCommands(state) {
  for (const command of state.commands) {
    const row = get('command-' + command.name) || addCommand(command);
    const refusal = fixed.live ? command.refusal : 'a recording cannot be commanded';
    row.classList.toggle('unfit', refusal !== '');
    const said = !refusal ? command.text : fixed.live ? `would be refused: ${words(refusal)}` : refusal;
    const span = row.querySelector('span');
    if (span.textContent !== said) span.textContent = said;
  }
}

function addCommand(command) {
  const row = element('div', '', 'command');
  row.id = 'command-' + command.name;
  const button = element('button', words(command.name), command.name);
  button.type = 'button';
  button.setAttribute('aria-describedby', 'why-' + command.name);
  const why = element('span', command.text);
  why.id = 'why-' + command.name;
  row.append(button, why);
  const inputs = Object.entries(command.arguments).map(([name, range]) => {
    const input = document.createElement('input');
    Object.assign(input, { type: 'number', min: range.low, max: range.high, step: 'any', value: 18, name: name });
    input.setAttribute('aria-label', `${words(name)}, ${range.low} to ${range.high} ${range.unit}`);
    const cell = document.createElement('div');
    cell.append(input, ` ${range.unit} `, why);
    row.append(cell);
    return input;
  });
  button.addEventListener('click', () => press(button, command.name, inputs));
  get('commands').append(row);
  return row;
}

// Firing takes a second press within three seconds: a stray key or finger must not be enough.
function press(button, name, inputs) {
  if (name === 'fire' && !button.classList.contains('sure')) {
    button.classList.add('sure');
    button.textContent = 'press again';
    setTimeout(() => { button.classList.remove('sure'); button.textContent = 'fire'; }, SURE_MS);
    return;
  }
  send(name, Object.fromEntries(inputs.map(input => [input.name, Number(input.value)])));
}

async function send(name, args) {
  const answer = await fetch('/command', { method: 'POST', headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ name: name, arguments: args }) });
  const content = answer.headers.get('Content-Type') === 'application/json' ? await answer.json() :
    { sent: false, why: await answer.text() };
  if (!content.sent) say(content.why);
}

function say(text) {
  get('status').textContent = text;
  get('status').hidden = text === '';
}

function show(state) {
  showStates(state);
  showGauges(state);
  showCommands(state);
  showLists(state);
  if (state.status) say(state.status);
}

function follow() {
  const stream = new EventSource('/stream');
  let lost = false;
  stream.onmessage = message => {
    const state = JSON.parse(message.data);
    if (lost || (!state.status && get('status').dataset.from === 'stream')) say('');
    lost = false;
    get('status').dataset.from = state.status ? 'stream' : '';
    show(state);
    drawLive(state.samples, state.time_s);
  };
  stream.onerror = () => { lost = true; say('The console on this computer does not answer: was it closed?'); };
}

async function playBack() {
  get('player').hidden = false;
  const slider = get('slider');
  const span = 0.01 * Math.ceil(100 * (fixed.end_s - fixed.start_s));  // whole steps, so that the end can be reached
  Object.assign(slider, { min: fixed.start_s, max: fixed.start_s + span, value: fixed.start_s });
  const all = () => fetch(`/series?low=${fixed.start_s}&high=${fixed.end_s}`).then(answer => answer.json());
  drawRecorded(await all(), fixed.start_s, fixed.end_s);
  for (const id of Object.keys(LINES)) {
    get(id).on('plotly_relayout', async change => {
      const low = change['xaxis.range[0]'], high = change['xaxis.range[1]'];
      if (low !== undefined) {
        drawRecorded(await (await fetch(`/series?low=${low}&high=${high}`)).json(), low, high);
      } else if (change['xaxis.autorange']) drawRecorded(await all(), fixed.start_s, fixed.end_s);
      else return;
      drawCursor(Number(slider.value));
    });
  }
  let asked = 0;
  async function goTo(time) {
    const mine = ++asked;
    const state = await (await fetch(`/state?at=${time}`)).json();
    if (mine !== asked) return;
    show(state);
    drawCursor(time);
    slider.setAttribute('aria-valuetext', `${Number(time).toFixed(1)} seconds, ${words(state.phase)}`);
  }
  slider.addEventListener('input', () => goTo(slider.value));
  let timer = null;
  function toggle() {
    if (timer) { clearInterval(timer); timer = null; } else {
      if (Number(slider.value) >= fixed.end_s) slider.value = fixed.start_s;
      timer = setInterval(() => {
        slider.value = Number(slider.value) + 0.2 * Number(get('speed').value);
        goTo(slider.value);
        if (Number(slider.value) >= fixed.end_s) toggle();
      }, 200);
    }
    get('play').textContent = timer ? '⏸ pause' : '▶ play';
  }
  get('play').addEventListener('click', toggle);
  goTo(fixed.start_s);
}

async function start() {
  fixed = await (await fetch('/about')).json();
  get('title').textContent = fixed.title;
  for (const [id, phases] of [['cycle', fixed.cycle], ['aside', fixed.aside]]) {
    get(id).append(...phases.map(phase => {
      const item = element('li', words(phase), ['armed', 'firing'].includes(phase) ? 'hot' : '');
      item.dataset.phase = phase;
      return item;
    }));
  }
  Object.assign(get('energy-meter'), { max: fixed.limits.energy_j });
  Object.assign(get('force-meter'), { max: fixed.limits.force_n });
  drawBelief([]);
  document.addEventListener('keydown', event => {
    if (event.key === 'x' && !event.ctrlKey && !event.metaKey && !event.altKey &&
        !['INPUT', 'SELECT'].includes(event.target.tagName)) send('abort', {});
  });
  if (fixed.live) follow(); else playBack();
}
start();
