// The console's plots. Lines are known by colour and by dash; surfaces by colour and by pattern.
'use strict';
const SHOWN_S = 60;
const COLOURS = ['#0072b2', '#e69f00', '#009e73', '#cc79a7', '#56b4e9', '#d55e00', '#999999'];
const PATTERNS = ['', '/', 'x', '.', '\\', '+', '-'];
const CONFIG = { responsive: true, displaylogo: false, displayModeBar: false };
const LINES = {
  'plot-compression': { title: 'compression [mm]', scale: 1e3, live: ['compression_m'], recorded: ['compression_m'] },
  'plot-current': { title: 'motor current [A]', scale: 1, live: ['current_a'], recorded: ['current_a'] },
  'plot-force': { title: 'specific force [m/s²]', scale: 1, live: ['highest_m_s2', 'lowest_m_s2'],
                  recorded: ['force_m_s2'] },
};
const COLUMNS = { compression_m: 1, current_a: 2, lowest_m_s2: 3, highest_m_s2: 4 };
const samples = [];

function css(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

function layout(title, extra) {
  const axis = { gridcolor: css('--line'), zerolinecolor: css('--line'), automargin: true };
  return Object.assign({
    paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', uirevision: 'keep',
    font: { color: css('--ink'), size: 12, family: 'system-ui, Segoe UI, Roboto, sans-serif' },
    margin: { l: 52, r: 12, t: 24, b: 28 }, showlegend: false,
    title: { text: title, font: { size: 12 }, x: 0.01, xanchor: 'left', y: 0.97 },
    xaxis: axis, yaxis: Object.assign({}, axis),
  }, extra);
}

function drawLive(fresh, now) {
  samples.push(...fresh);
  while (samples.length && samples[0][0] < now - 600) samples.shift();
  const first = samples.findIndex(row => row[0] >= now - SHOWN_S);
  const shown = first < 0 ? [] : samples.slice(first);
  const t = shown.map(row => row[0]);
  for (const [id, line] of Object.entries(LINES)) {
    const traces = line.live.map((name, index) => ({
      x: t, y: shown.map(row => row[COLUMNS[name]] === null ? null : line.scale * row[COLUMNS[name]]), mode: 'lines',
      name: name === 'highest_m_s2' ? 'highest' : name === 'lowest_m_s2' ? 'lowest' : line.title,
      line: { color: css(index ? '--amber' : '--blue'), dash: index ? 'dot' : 'solid', width: 1.6 },
    }));
    const range = { range: [Math.max(0, now - SHOWN_S), Math.max(now, SHOWN_S)] };
    const title = line.live.length > 1 ? line.title + ', highest ─ and lowest ┈ of each message' : line.title;
    const drawn = layout(title);
    Object.assign(drawn.xaxis, range);
    Plotly.react(id, traces, drawn, CONFIG);
  }
}

function drawRecorded(series, low, high) {
  for (const [id, line] of Object.entries(LINES)) {
    const traces = line.recorded.map(name => ({
      x: series[name].t, y: series[name].v.map(v => line.scale * v), mode: 'lines',
      line: { color: css('--blue'), width: 1.2 },
    }));
    const drawn = layout(line.title + '  (drag to zoom, double click for all)');
    drawn.xaxis.range = [low, high];
    Plotly.react(id, traces, drawn, CONFIG);
  }
}

function drawCursor(time) {
  for (const id of Object.keys(LINES)) {
    if (!document.getElementById(id).data) continue;
    Plotly.relayout(id, { shapes: [{ type: 'line', x0: time, x1: time, yref: 'paper', y0: 0, y1: 1,
                                     line: { color: css('--danger'), width: 2 } }] });
  }
}

function drawBelief(hops) {
  const known = hops.filter(hop => hop.belief);
  const names = known.length ? Object.keys(known[known.length - 1].belief.surfaces) : [];
  const traces = names.map((name, index) => ({
    type: 'bar', name: words(name), x: known.map(hop => hop.hop_index + 1),
    y: known.map(hop => 100 * (hop.belief.surfaces[name] || 0)),
    marker: { color: COLOURS[index % 7], pattern: { shape: PATTERNS[index % 7], bgcolor: COLOURS[index % 7],
                                                       fgcolor: css('--paper'), size: 7 } },
    hovertemplate: '%{fullData.name}: %{y:.0f} %<extra></extra>',
  }));
  const drawn = layout('probability [%] over hops', { barmode: 'stack', showlegend: true,
    legend: { orientation: 'h', y: -0.14, font: { size: 11 } } });
  Object.assign(drawn.xaxis, { dtick: 1 }, known.length ? {} : { range: [0.5, 5.5] });
  Object.assign(drawn.yaxis, { range: [0, 100] });
  Plotly.react('plot-belief', traces, drawn, CONFIG);
  const last = known[known.length - 1];
  document.getElementById('said').textContent = !last ? 'no hop on unknown ground yet' :
    `After hop ${last.hop_index + 1} on place ${last.place}: ${words(last.belief.said)}, C3 ` +
    `${(100 * last.belief.c3_mean).toFixed(1)} ± ${(100 * last.belief.c3_std).toFixed(1)} %.`;
}
