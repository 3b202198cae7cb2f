#include "server/report_page/report_style.h"

namespace tessera {

std::string_view ReportStyle() {
  return R"css(
:root { --paper:#ffffff; --card:#f5f7f9; --line:#dde3e8; --ink:#1b2530; --soft:#5b6875;
  --accent:#2f6db5; --pale:#b9d0ea; --warn:#8a5a00; --warn-card:#fff6e0; --bad:#a8202b; --bad-card:#fdecec; }
@media (prefers-color-scheme: dark) { :root { --paper:#12171d; --card:#1a2129; --line:#2d3742; --ink:#e6ebf0;
  --soft:#9aa7b4; --accent:#6ea8ec; --pale:#2d4a6d; --warn:#f0c060; --warn-card:#2c2413; --bad:#ff8f8f;
  --bad-card:#331a1c; } }
@media print { :root { --paper:#ffffff; --card:#f7f8f9; --line:#d5dade; --ink:#000000; --soft:#4a545e;
  --accent:#2f6db5; --pale:#b9d0ea; --warn:#8a5a00; --warn-card:#fff6e0; --bad:#a8202b; --bad-card:#fdecec; } }
@page { size:A4; margin:14mm; }
* { box-sizing:border-box; }
html { -webkit-text-size-adjust:100%; print-color-adjust:exact; -webkit-print-color-adjust:exact; }
body { margin:0; background:var(--paper); color:var(--ink); font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,
  "Helvetica Neue",Arial,sans-serif; overflow-wrap:anywhere; }
main { max-width:1120px; margin:0 auto; padding:32px 24px 48px; }
header { border-bottom:1px solid var(--line); padding-bottom:18px; margin-bottom:22px; }
.over { color:var(--soft); font-size:13px; letter-spacing:.06em; text-transform:uppercase; margin:0; }
h1 { font-size:30px; line-height:1.2; margin:2px 0 6px; font-weight:650; }
h2 { font-size:19px; margin:34px 0 12px; font-weight:650; }
h3 { font-size:14px; margin:0 0 2px; font-weight:650; }
p { margin:0 0 8px; }
.sub { color:var(--soft); margin:0; }
.soft { color:var(--soft); font-size:13px; }
.note { border-left:4px solid var(--accent); background:var(--card); padding:10px 14px; border-radius:4px;
  margin:0 0 12px; }
.note.warn { border-color:var(--warn); background:var(--warn-card); }
.note.bad { border-color:var(--bad); background:var(--bad-card); }
.figures { display:grid; grid-template-columns:repeat(auto-fill,minmax(158px,1fr)); gap:10px; margin:0; }
.figures div { background:var(--card); border:1px solid var(--line); border-radius:6px; padding:10px 12px; }
.figures dt { color:var(--soft); font-size:12.5px; }
.figures dd { margin:0; font-size:20px; font-weight:600; line-height:1.3; font-variant-numeric:tabular-nums; }
.figures dd.small { font-size:13px; font-weight:400; color:var(--soft); line-height:1.35; }
.pair { display:grid; grid-template-columns:repeat(auto-fit,minmax(min(100%,400px),1fr)); gap:14px; margin:0 0 14px; }
figure { margin:0; break-inside:avoid; }
figure img { display:block; width:100%; height:auto; border-radius:6px; border:1px solid var(--line); }
figcaption { color:var(--soft); font-size:13px; margin:5px 0 0; }
figcaption b { color:var(--ink); font-weight:600; }
.legend { display:flex; flex-wrap:wrap; gap:4px 16px; font-size:13px; margin:0 0 16px; padding:0; list-style:none; }
.legend span { display:inline-block; width:12px; height:12px; border-radius:3px; margin-right:6px;
  vertical-align:-1px;
  border:1px solid var(--line); }
.scale { height:10px; border-radius:3px; margin:8px 0 2px; border:1px solid var(--line); }
.ends { display:flex; justify-content:space-between; color:var(--soft); font-size:12px;
  font-variant-numeric:tabular-nums; }
.plots { display:grid; grid-template-columns:repeat(auto-fit,minmax(min(100%,400px),1fr)); gap:22px 26px;
  align-items:start; }
.plots figure { border-top:1px solid var(--line); padding-top:10px; }
.plots figure > p { margin:0 0 6px; }
svg { display:block; width:100%; max-width:560px; height:auto; font-family:inherit; font-size:12px; }
svg .grid { stroke:var(--line); stroke-width:1; }
svg .tick { fill:var(--soft); }
svg .name, svg .value { fill:var(--ink); }
svg .value { font-variant-numeric:tabular-nums; paint-order:stroke; stroke:var(--paper); stroke-width:3px; }
svg .used { fill:var(--accent); }
svg .compared { fill:var(--pale); }
svg .neutral { fill:var(--soft); }
svg .neutral.pale { fill-opacity:.35; }
svg .line { fill:none; stroke:var(--accent); stroke-width:2.2; stroke-linejoin:round; }
svg .thin { fill:none; stroke:var(--pale); stroke-width:1; }
.scroll { overflow-x:auto; overflow-wrap:break-word; }
.scroll td:last-child { min-width:150px; }
table { border-collapse:collapse; width:100%; font-size:13.5px; }
th, td { text-align:left; padding:5px 10px 5px 0; border-bottom:1px solid var(--line); vertical-align:top; }
th { color:var(--soft); font-weight:500; }
td.number, th.number { text-align:right; font-variant-numeric:tabular-nums; white-space:nowrap; }
tr { break-inside:avoid; }
table.facts th { width:34%; min-width:110px; }
.bad { color:var(--bad); }
.warn { color:var(--warn); }
ul { margin:0; padding-left:20px; }
li { margin:0 0 4px; }
code { font:12.5px/1.5 ui-monospace,SFMono-Regular,Menlo,Consolas,monospace; background:var(--card); padding:1px 4px;
  border-radius:3px; }
footer { margin-top:36px; padding-top:12px; border-top:1px solid var(--line); color:var(--soft); font-size:12.5px; }
@media (max-width:520px) { main { padding:20px 14px 32px; } h1 { font-size:24px; } body { font-size:14px; }
  .figures { grid-template-columns:repeat(2,minmax(0,1fr)); } th, td { padding-right:8px; } }
@media print { main { max-width:none; padding:0; } .pair { grid-template-columns:1fr 1fr; }
  .plots { grid-template-columns:1fr 1fr; }
  h2 { break-after:avoid; } .scroll { overflow:visible; } body { font-size:10.5pt; }
  .figures { grid-template-columns:repeat(4,1fr); }
  .figures dd { font-size:12pt; } }
)css";
}

}  // namespace tessera
