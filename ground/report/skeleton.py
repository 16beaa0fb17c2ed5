"""What every page carries: its style for light and dark, and the script that draws its figures."""

from __future__ import annotations

STYLE = """
:root { --paper:#ffffff; --ink:#1c2026; --soft:#5d6570; --line:#d9dde3; --band:#f4f6f8;
  --good:#1f7a4d; --bad:#b3261e }
@media (prefers-color-scheme: dark) {
  :root { --paper:#14171c; --ink:#e6e9ee; --soft:#9aa3af; --line:#343a43; --band:#1c2129;
    --good:#5fce95; --bad:#ff8a80 }
}
* { box-sizing:border-box }
body { margin:0; background:var(--paper); color:var(--ink);
  font:16px/1.55 system-ui,"Segoe UI",Roboto,sans-serif }
main { max-width:1080px; margin:0 auto; padding:2rem 1.25rem 4rem }
h1 { font-size:1.7rem; line-height:1.2; margin:0 0 1rem }
h2 { font-size:1.2rem; margin:2.4rem 0 .5rem; padding-top:.9rem; border-top:1px solid var(--line) }
p { max-width:76ch; margin:.5rem 0 }
.verdict { max-width:none; font-size:1.15rem; padding:.8rem 1rem; background:var(--band);
  border-left:4px solid var(--soft) }
.verdict.good { border-color:var(--good) } .verdict.bad { border-color:var(--bad) }
.wide { overflow-x:auto; margin:.8rem 0 }
table { border-collapse:collapse; font-size:.92rem; font-variant-numeric:tabular-nums }
caption { caption-side:bottom; text-align:left; color:var(--soft); padding-top:.4rem }
th,td { padding:.32rem .7rem; border-bottom:1px solid var(--line); text-align:left; vertical-align:top }
th { color:var(--soft); font-weight:600; white-space:nowrap }
.figures { text-align:right; white-space:nowrap }
td.good { color:var(--good) } td.bad { color:var(--bad); font-weight:600 } td.muted { color:var(--soft) }
figure { margin:1rem 0 } figcaption { color:var(--soft); font-size:.9rem; max-width:90ch }
pre { background:var(--band); padding:.7rem 1rem; overflow-x:auto; font-size:.88rem }
@media print { main { max-width:none } figure { break-inside:avoid } }
"""

DRAW_SCRIPT = """
(function () {
  const dark = matchMedia('(prefers-color-scheme: dark)');
  function colour(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }
  function look() {
    const axis = { gridcolor: colour('--line'), linecolor: colour('--line'), zerolinecolor: colour('--line'),
                   automargin: true, title: { standoff: 8 } };
    return { layout: {
      paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', xaxis: axis, yaxis: axis,
      font: { color: colour('--ink'), size: 13, family: 'system-ui, Segoe UI, Roboto, sans-serif' },
      colorway: ['#3b82f6', '#e0763a', '#35a06a', '#a06bd6', '#dc4c64', '#8a8f98'],
      margin: { l: 64, r: 20, t: 36, b: 48 }, legend: { orientation: 'h', y: 1.02, yanchor: 'bottom', x: 0 },
      modebar: { bgcolor: 'rgba(0,0,0,0)', color: colour('--line'), activecolor: colour('--soft') },
      hoverlabel: { bgcolor: colour('--band'), font: { color: colour('--ink') } } } };
  }
  function draw() {
    document.querySelectorAll('script[data-for]').forEach(function (source) {
      const figure = JSON.parse(source.textContent);
      figure.layout.template = look();
      Plotly.react(source.dataset.for, figure.data, figure.layout, { responsive: true, displaylogo: false });
    });
  }
  async function unpack() {
    const bytes = Uint8Array.from(atob(document.getElementById('plotly').textContent), c => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
    const script = document.createElement('script');
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  }
  unpack().then(function () { draw(); dark.addEventListener('change', draw); });
})();
"""
