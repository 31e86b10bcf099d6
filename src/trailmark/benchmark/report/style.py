"""The page's style: dark on white, one column on a phone, tables that scroll, and what printing needs."""

# Tested by tests/benchmark/report/test_browser.py.
__all__ = ["STYLE"]

STYLE = """
:root { color-scheme: light; --ink: #16191d; --soft: #535a64; --line: #d5d9df; --pale: #f4f5f7; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
body { margin: 0 auto; padding: 0 clamp(12px, 3vw, 32px) 64px; max-width: 1440px; background: #fff; color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: clamp(1.5rem, 4vw, 2.1rem); line-height: 1.2; margin: 28px 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 1.35rem; margin: 44px 0 8px; padding-top: 10px; border-top: 2px solid var(--ink); }
h3 { font-size: 1.05rem; margin: 26px 0 4px; }
p, li { max-width: 78ch; }
p { margin: 6px 0 10px; }
.sub, figcaption, .caption, .note { color: var(--soft); }
.sub { margin-top: 0; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 14px 0; font-size: .95rem; }
a { color: #004f86; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 260px), 1fr)); gap: 12px;
  margin: 16px 0; }
.card { border: 1px solid var(--line); border-top: 4px solid var(--ink); border-radius: 4px; padding: 12px 14px; }
.card p { margin: 4px 0 0; font-size: .92rem; }
.card .question { font-size: .8rem; letter-spacing: .04em; text-transform: uppercase; color: var(--soft); }
.card .answer { font-size: 1.12rem; font-weight: 650; overflow-wrap: anywhere; line-height: 1.25; }
.card .value { font-size: 1.5rem; font-weight: 650; line-height: 1.3; font-variant-numeric: tabular-nums; }
.warning { border-left: 4px solid #b35900; background: #fdf4e9; padding: 8px 12px; max-width: none; }
.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 360px), 1fr)); gap: 6px 22px; }
figure { display: grid; grid-row: span 2; grid-template-rows: subgrid; align-content: start; margin: 8px 0;
  min-width: 0; }
figcaption { font-size: .9rem; align-self: end; }
figcaption b { color: var(--ink); display: block; font-size: 1rem; }
svg.chart { display: block; width: 100%; height: auto; overflow: visible;
  font: 12px system-ui, "Segoe UI", Roboto, Arial, sans-serif; }
svg.key { width: 28px; height: 14px; vertical-align: -2px; margin-right: 6px; }
/* On the root only: a rule for shapes would win over their own fill. */
svg { fill: none; }
svg text { fill: var(--soft); }
svg text.name, svg text.value { fill: var(--ink); }
svg text.value, svg text.tick { font-variant-numeric: tabular-nums; }
svg .halo { paint-order: stroke; stroke: #fff; stroke-width: 3px; }
svg .grid { stroke: #e6e8ec; } svg .axis { stroke: #6b727c; }
.share { stroke-width: 1.8; }
.box { stroke-width: 1.4; fill-opacity: .3; }
.median { stroke-width: 3; }
svg .line { stroke-linejoin: round; stroke-linecap: round; }
svg .halo-line { stroke: #fff; stroke-opacity: .85; stroke-linejoin: round; }
.outside { fill: #e3e6ea; }
.free { fill: #fff; stroke: #4a5059; }
svg .body { fill: #16191d; fill-opacity: .05; stroke: #16191d; stroke-opacity: .35; stroke-width: .8; }
svg .refused { stroke: #c00; stroke-width: 1.2; stroke-dasharray: 2 2; }
svg .end { fill: #fff; stroke: #16191d; stroke-width: 1.6; } svg .end.goal { fill: #b9bfc8; }
svg .heading { stroke: #16191d; stroke-width: 1.8; } svg .tip { fill: #16191d; stroke: #fff; stroke-width: 1; }
svg .heading.goal { stroke: #16191d; }
svg text.letter { fill: #000; font-weight: 700; font-size: 13px; paint-order: stroke; stroke: #fff;
  stroke-width: 4px; }
.defs { position: absolute; width: 0; height: 0; }
.table { position: relative; margin: 2px 0 18px; }
.scroll { overflow-x: auto; border-bottom: 1px solid var(--line); -webkit-overflow-scrolling: touch; }
/* Both say that there is more: a bar that is always there, and a shadow on the side that is cut off. */
.scroll::-webkit-scrollbar { height: 10px; } .scroll::-webkit-scrollbar-track { background: var(--pale); }
.scroll::-webkit-scrollbar-thumb { background: #9aa1ab; border-radius: 5px; }
.table.more::after { content: ""; position: absolute; inset: 0 0 10px auto; width: 30px; pointer-events: none;
  background: linear-gradient(to right, transparent, rgb(22 25 29 / .3)); border-right: 2px solid #535a64; }
table { border-collapse: collapse; font-size: .86rem; min-width: 100%; }
.caption { margin: 18px 0 0; font-size: .92rem; }
th, td { padding: 4px 10px; text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums;
  vertical-align: baseline; }
thead th { border-bottom: 2px solid var(--ink); white-space: normal; min-width: 4.6em; vertical-align: bottom;
  line-height: 1.25; }
tbody tr:nth-child(even) > * { background: var(--pale); }
th.words, td.words, tbody th { text-align: left; }
tbody th { font-weight: 550; position: sticky; left: 0; background: #fff; border-right: 1px solid var(--line); }
td.long { max-width: 46em; white-space: normal; min-width: 26em; overflow-wrap: anywhere; }
button { font: inherit; font-size: .88rem; color: #004f86; background: #fff; border: 1px solid var(--line);
  border-radius: 4px; padding: 3px 9px; cursor: pointer; }
button:hover { background: var(--pale); }
#choice label { display: flex; align-items: center; gap: 4px; padding: 2px; overflow-wrap: anywhere; min-width: 0; }
#choice label .key, #choice input { flex: none; } #choice { font-size: .9rem; }
.family { margin: 8px 0; } .family button { font-weight: 650; padding: 0; border: 0; color: var(--soft); }
#filter { font: inherit; width: 100%; margin-bottom: 6px; padding: 3px 6px; }
#planners { max-height: 26rem; overflow-y: auto; }
#pointed { position: fixed; left: 12px; bottom: 12px; margin: 0; padding: 4px 10px; background: #fff; font-weight: 650;
  border: 1px solid var(--ink); border-radius: 4px; pointer-events: none; max-width: calc(100vw - 24px); }
#problems { max-height: 16rem; overflow-y: auto; margin-top: 6px; }
#problems div { display: flex; gap: 4px; align-items: baseline; }
#problems button { border: 0; padding: 1px 2px; text-align: left; overflow-wrap: anywhere; min-width: 0; }
#problems [aria-current] { font-weight: 650; color: var(--ink); }
fieldset { border: 1px solid var(--line); border-radius: 4px; margin: 8px 0; }
[hidden], #failed:empty, #pointed:empty, #explore:not(.ready) .explorer { display: none; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 2px 14px; font-size: .9rem; }
dd { margin: 0; overflow-wrap: anywhere; }
details { margin: 8px 0; border: 1px solid var(--line); border-radius: 4px; padding: 0 12px; }
details[open] { padding-bottom: 12px; }
summary { cursor: pointer; padding: 9px 0; font-weight: 650; overflow-wrap: anywhere; }
summary .note { font-weight: 400; font-size: .9rem; }
@media (max-width: 600px) { body { font-size: 15px; } th, td { padding: 4px 7px; } tbody th { white-space: normal; }
  .scroll .key { width: 22px; margin-right: 3px; } }
@media (min-width: 601px) { wbr { display: none; } }
@media (min-width: 800px) { figure.wide { grid-column: span 2; } }
@media (min-width: 1000px) {
  .explorer { display: grid; grid-template-columns: 250px minmax(0, 1fr); gap: 24px; align-items: start; }
  #choice { position: sticky; top: 0; max-height: 100vh; overflow-y: auto; }
}
@media print {
  @page { margin: 14mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  nav, #choice, #pointed, button { display: none; } .explorer { display: block; }
  h2 { break-after: avoid; } h3, summary { break-after: avoid; }
  figure, .card, tr, .warning { break-inside: avoid; }
  .figures { grid-template-columns: 1fr 1fr; gap: 4mm 8mm; }
  .cards { grid-template-columns: 1fr 1fr; }
  details { border: 0; padding: 0; }
  details::details-content { content-visibility: visible; display: block; height: auto; }
  .scroll { overflow: visible; } .table.more::after { display: none; } .scroll .key { display: none; }
  table { font-size: 6.3pt; min-width: 0; } th, td { padding: 1.2pt 2.2pt; white-space: normal; }
  thead th { min-width: 0; } tbody th { position: static; } wbr { display: inline; }
  td.long { min-width: 7em; max-width: 24em; overflow-wrap: anywhere; }
  tbody tr:nth-child(even) > *, svg * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
