"""The page that `report` fills in."""

from typing import Final

PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$word: $name</title>
<style>
:root { --ink: #1f2933; --soft: #616e7c; --rule: #e4e7eb; --pass: #18794e; --fail: #c62828; }
* { box-sizing: border-box; }
body { margin: 0; background: #f5f7fa; color: var(--ink);
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 24px; }
header { display: flex; gap: 24px; align-items: center; background: #fff; border-radius: 8px;
  border-left: 10px solid; padding: 20px 28px; }
header.pass { border-color: var(--pass); } header.fail { border-color: var(--fail); }
header strong { font-size: 46px; line-height: 1; letter-spacing: 1px; }
header.pass strong { color: var(--pass); } header.fail strong { color: var(--fail); }
h1 { font-size: 22px; margin: 0; } header p { margin: 2px 0 0; color: var(--soft); }
h2 { font-size: 17px; margin: 0 0 12px; }
section { background: #fff; border-radius: 8px; padding: 20px 28px; margin-top: 16px;
  overflow-x: auto; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(170px, 1fr)); gap: 16px;
  margin-top: 16px; }
.tile { background: #fff; border-radius: 8px; padding: 14px 20px; }
.tile b { display: block; font-size: 26px; font-weight: 600; }
.tile span { display: block; } .tile small { color: var(--soft); }
img, svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; }
td, th { padding: 6px 10px; border-bottom: 1px solid var(--rule); text-align: left;
  vertical-align: top; }
th { font-weight: 600; color: var(--soft); white-space: nowrap; }
td small { display: block; color: var(--soft); }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.mark { font-weight: 700; } tr.pass .mark { color: var(--pass); }
tr.fail .mark, tr.fail .number { color: var(--fail); } tr.fail { background: #fdf0f0; }
.bar { width: 90px; height: 8px; margin-top: 7px; background: var(--rule); border-radius: 4px; }
.bar i { display: block; height: 8px; border-radius: 4px; background: var(--pass); }
tr.fail .bar i { background: var(--fail); }
code { font: 13px/1.5 ui-monospace, "DejaVu Sans Mono", monospace; }
.facts th { width: 1%; } p.note { color: var(--soft); margin: 8px 0 0; }
@media print { body { background: #fff; } section { break-inside: avoid; } }
</style>
</head>
<body>
<main>
<header class="$state"><strong>$word</strong>
<div><h1>$name</h1><p>$headline</p><p>$where</p></div></header>
<div class="tiles">$tiles</div>
<section><h2>Path, rebuilt from the step edges</h2>
<img alt="path of the tool coloured by speed" src="data:image/png;base64,$picture"></section>
<section><h2>Checks</h2>
<table><thead><tr><th></th><th>what</th><th>where</th><th class="number">worst</th>
<th class="number">bound</th><th>unit</th><th>used</th><th class="number">line</th>
<th class="number">time [s]</th></tr></thead>
<tbody>$checks</tbody></table></section>
<section><h2>Program where margins are least</h2>
<table><thead><tr><th class="number">line</th><th>program</th><th>checks</th></tr></thead>
<tbody>$places</tbody></table></section>
<section><h2>Speed and acceleration</h2>$dynamics
<p class="note">Of X, Y, Z, by differences of the step counts over $speed_window ms and
$acceleration_window ms; the largest in each column.</p></section>
$plan<section><h2>Following deviation</h2>$deviation
<p class="note">Count minus planned position of each motor, just before and just after every step.
Whole steps cannot do better than half a step.</p></section>
<section><h2>Motors</h2>
<table><thead><tr><th>motor</th><th class="number">steps</th><th class="number">forward</th>
<th class="number">backward</th><th class="number">start</th><th class="number">end</th>
<th class="number">planned end</th><th class="number">lost</th>
<th class="number">largest deviation</th></tr></thead>
<tbody>$motors</tbody></table></section>
<section><h2>What was run</h2><table class="facts">$facts</table></section>
</main>
</body>
</html>
"""
