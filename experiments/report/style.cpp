#include "experiments/report/page.h"

namespace palpate::experiments {

const char* page_style() {
  return R"css(
:root { color-scheme: light dark; --ink:#1c2126; --soft:#59636e; --paper:#fbfbf9; --card:#ffffff; --line:#dfe2e6; --accent:#0072b2; --best:#00694f; --bad:#b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink:#e7e9ec; --soft:#a3adb8; --paper:#15181b; --card:#1d2226; --line:#363d44; --accent:#6cb8ea; --best:#5fd0aa; --bad:#ff8a80; } }
* { box-sizing: border-box; }
body { margin:0; background:var(--paper); color:var(--ink); font:16px/1.55 system-ui,-apple-system,"Segoe UI","Liberation Sans",Helvetica,Arial,sans-serif; }
main { max-width:72rem; margin:0 auto; padding:1.5rem clamp(.9rem,3vw,2.5rem) 4rem; }
h1 { font-size:clamp(1.5rem,4vw,2.2rem); line-height:1.2; margin:.6rem 0 .2rem; }
h2 { font-size:1.4rem; margin:2.8rem 0 .5rem; padding-top:1rem; border-top:2px solid var(--line); }
p { margin:.5rem 0; max-width:48rem; overflow-wrap:anywhere; }
.by { max-width:none; color:var(--soft); font-size:.92rem; }
.headline { background:var(--card); border:1px solid var(--line); border-left:5px solid var(--accent); border-radius:6px; padding:.4rem 1.2rem .9rem; margin:1.2rem 0; }
.answer { border-left:5px solid var(--best); background:var(--card); padding:.3rem 1.2rem; margin:.8rem 0; } .answer dl.found { font-size:1.06rem; } .answer dt { color:var(--ink); font-weight:600; }
.first :is(th,td) { white-space:normal; min-width:0; } .first th:first-child { min-width:3.5rem; }
.headline h2 { font-size:1.02rem; margin:1rem 0 .25rem; padding:0; border:0; }
.known { border:1px solid var(--line); border-left:5px solid var(--bad); border-radius:6px; background:var(--card); padding:.4rem 1.2rem .7rem; margin:1.2rem 0; font-size:.95rem; }
.known h2 { font-size:1.02rem; margin:.5rem 0 .25rem; padding:0; border:0; } .known ul { margin:.2rem 0; padding-left:1.1rem; } .known li { overflow-wrap:anywhere; } .known .warning strong { color:var(--bad); }
.verdict { max-width:none; margin:.5rem 0; padding:.5rem .9rem; border-left:5px solid var(--bad); background:var(--card); } .verdict.reached { border-color:var(--best); } .verdict.reached strong { color:var(--best); } .verdict.part { border-color:#c77700; } .verdict.missed strong { color:var(--bad); } .verdict a { color:inherit; }
td a, th a { color:var(--accent); } nav { font-size:.95rem; margin:.8rem 0; } nav a { color:var(--accent); margin-right:1.1rem; display:inline-block; }
.scroll { overflow-x:auto; margin:1.1rem 0 .3rem; border:1px solid var(--line); border-radius:6px; background:var(--card); }
table { border-collapse:collapse; width:100%; font-size:.93rem; font-variant-numeric:tabular-nums; }
caption { text-align:left; padding:.6rem .8rem; font-weight:600; overflow-wrap:anywhere; }
th, td { padding:.34rem .8rem; text-align:right; white-space:nowrap; border-top:1px solid var(--line); }
thead th { font-weight:600; border-bottom:2px solid var(--line); white-space:normal; vertical-align:bottom; min-width:5.5rem; }
th:first-child { text-align:left; font-weight:400; min-width:8rem; white-space:normal; position:sticky; left:0; background:var(--card); }
tr.group th { font-weight:600; color:var(--soft); padding-top:.9rem; font-size:.85rem; letter-spacing:.02em; }
td.best { font-weight:700; color:var(--best); } td.bad { font-weight:700; color:var(--bad); } td.best, td.bad { position:relative; } .mark { position:absolute; padding-left:.08em; }
:is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) { font-size:.82rem; } :is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) :is(th,td) { padding:.3rem .5rem .3rem .4rem; min-width:0; }
.turned th:first-child { white-space:nowrap; } td.words { text-align:left; white-space:normal; } thead th.words { text-align:left; }
:is(th,td):last-child { padding-right:1rem; } .legend { margin:.2rem 0; } .legend span { margin-right:1.4rem; white-space:nowrap; }
.caption, .legend, .notes, .facts { color:var(--soft); font-size:.88rem; } .notes { padding-left:1.2rem; max-width:60rem; }
h3 { font-size:1rem; margin:1.4rem 0 .3rem; }
.figures { display:grid; grid-template-columns:repeat(2,minmax(0,1fr)); gap:1.1rem; margin:1.2rem 0; }
figure { margin:0; background:var(--card); border:1px solid var(--line); border-radius:6px; padding:.7rem .8rem; min-width:0; }
figure.wide { grid-column:1/-1; }
figure h3 { margin:.1rem .2rem .4rem; font-size:1rem; }
figure .picture { background:#fff; border-radius:4px; overflow-x:auto; } figure svg { display:block; width:100%; height:auto; }
figcaption { color:var(--soft); font-size:.87rem; margin:.45rem .2rem 0; }
pre { background:var(--card); border:1px solid var(--line); border-radius:6px; padding:.7rem .9rem; overflow-x:auto; font-size:.86rem; white-space:pre-wrap; overflow-wrap:anywhere; }
dl { display:grid; grid-template-columns:minmax(7.5rem,max-content) 1fr; gap:.2rem 1.2rem; margin:.3rem 0; font-size:.93rem; } dt { color:var(--soft); } dd { margin:0; overflow-wrap:anywhere; max-width:54rem; }
dl.found { grid-template-columns:11.5rem 1fr; font-size:.97rem; } dl.found dd { max-width:none; } dl.facts { gap:.45rem 1.2rem; font-size:.86rem; } dl.facts dt { color:var(--ink); font-weight:600; }
@media (max-width:46rem) { .figures { grid-template-columns:minmax(0,1fr); } figure.wide .picture svg { min-width:34rem; } th,td { padding:.3rem .55rem; } dl, dl.found, dl.facts { grid-template-columns:minmax(0,1fr); gap:0; } dd { margin-bottom:.5rem; } dl.found dt { font-weight:600; } }
@media print {
  :root { --ink:#000; --soft:#444; --paper:#fff; --card:#fff; --line:#bbb; --accent:#0072b2; --best:#00694f; --bad:#b3261e; }
  @page { size:A4; margin:14mm; }
  body { font-size:10pt; } main { max-width:none; padding:0; } nav { display:none; }
  table { font-size:8.4pt; } :is(.n8,.n9,.n10) { font-size:7.6pt; } :is(.n11,.n12,.n13) { font-size:6.6pt; } :is(.n14,.n15,.n16) { font-size:5.8pt; }
  table :is(th,td), :is(.n10,.n11,.n12,.n13,.n14,.n15,.n16) :is(th,td) { padding:.14rem .38rem; min-width:0; } th:first-child { position:static; } :is(th,td):last-child { padding-right:.6rem; } .legend span { white-space:normal; } .scroll { border:0; border-radius:0; margin:.6rem 0 .2rem; }
  .turned { break-inside:avoid; } tbody tr:first-child, tr.group + tr { break-before:avoid; }
  h2 { break-after:avoid; } figure, .headline dl, tr, dd, pre { break-inside:avoid; } h3, dt, caption { break-after:avoid; } .scroll, figure .picture { overflow:visible; } thead { display:table-header-group; }
}
)css";
}

}  // namespace palpate::experiments
