// The look of the reports: one style sheet for the screen and for A4.
#include "reports/html.h"

namespace fringecal::reports {
namespace {

constexpr const char* kStyle = R"css(
:root{--ink:#1b1f24;--soft:#55606c;--line:#d9dde2;--faint:#f4f6f8;--accent:#0b5a7a;--good:#1d6b3c;--bad:#a11f2a;
--sans:"Source Sans 3","Source Sans Pro","Segoe UI","Helvetica Neue",Arial,"Liberation Sans","DejaVu Sans",sans-serif;
--serif:Charter,"Iowan Old Style","Source Serif 4","Palatino Linotype",Georgia,"Liberation Serif","DejaVu Serif",serif}
*{box-sizing:border-box}
html{background:#e9ecef;-webkit-text-size-adjust:100%}
body{margin:0;color:var(--ink);font:15px/1.5 var(--sans);font-variant-numeric:tabular-nums lining-nums;
-webkit-print-color-adjust:exact;print-color-adjust:exact}
main{max-width:1120px;margin:24px auto;padding:44px 56px 56px;background:#fff;box-shadow:0 1px 3px rgba(20,30,40,.18)}
h1,h2,h3{font-family:var(--serif);font-weight:600;line-height:1.2;margin:0}
h1{font-size:34px;letter-spacing:-.005em}
h2{font-size:23px;margin:0 0 14px;padding-top:16px;border-top:2px solid var(--ink)}
h3{font-size:17px;margin:26px 0 8px}
p{margin:0 0 12px;max-width:74ch}
a{color:var(--accent)}
section{margin-top:44px}
.kicker{font-size:12px;letter-spacing:.09em;text-transform:uppercase;color:var(--soft);margin:0 0 10px;max-width:none}
.kicker b{color:var(--accent)}
.note{color:var(--soft);font-size:13.5px;max-width:92ch}
.facts{display:flex;flex-wrap:wrap;gap:6px 34px;margin:12px 0 0;padding:0;list-style:none;font-size:14px}
.facts span{color:var(--soft)}
.virtual{margin:20px 0 0;padding:10px 16px 10px 20px;font-size:14px;max-width:none;
border-left:6px solid #c98a12;background:#fdf5e3}
.virtual b{font-size:15.5px}
.overall{display:flex;gap:18px;align-items:flex-start;margin:22px 0 0}
.overall .mark svg{width:38px;height:38px;margin-top:2px}
.overall p{font:600 21px/1.35 var(--serif);margin:0;max-width:52ch}
.overall .word{margin-bottom:1px;display:block;font:700 12px/1.5 var(--sans);letter-spacing:.09em;text-transform:uppercase}
.lines{list-style:none;margin:14px 0 0 56px;padding:0;columns:2;column-gap:36px;font-size:14px}
.lines li{break-inside:avoid;display:flex;gap:9px;margin:0 0 5px}
.lines .mark{flex:none;margin-top:3px}
.mark{white-space:nowrap}
.mark svg{width:14px;height:14px;vertical-align:-2px}
.met{color:var(--good)}.not-met{color:var(--bad)}.not-judged{color:var(--soft)}
nav{margin:26px 0 0;font-size:13.5px;color:var(--soft)}
nav a{margin-right:20px;text-decoration:none;white-space:nowrap}
nav a:hover{text-decoration:underline}
table{border-collapse:collapse;margin:10px 0 8px;font-size:14px;line-height:1.4}
table.full{width:100%}
th,td{padding:6px 12px 6px 0;text-align:left;vertical-align:top;border-bottom:1px solid var(--line)}
th:last-child,td:last-child{padding-right:0}
thead th{font-weight:600;font-size:12.5px;line-height:1.3;color:var(--soft);vertical-align:bottom;
border-bottom:1.5px solid var(--ink)}
thead .groups th{border:0;padding-bottom:2px;letter-spacing:.06em;text-transform:uppercase;font-size:11px}
thead .groups th.group{color:var(--accent);text-align:center;border-bottom:1px solid var(--line)}
tbody th{font-weight:600}
.number{text-align:right;white-space:nowrap}
td.number,th.number{padding-left:6px}
.of{color:var(--soft);font-weight:400}
.sub{display:block;color:var(--soft);font-weight:400;font-size:.88em}
sup,sub{line-height:0;font-size:.75em}
.bar{display:block;margin:3px 0 0 auto;width:72px;height:7px}
.bar .track{fill:#e3e7eb}.bar .fill{fill:var(--accent)}.bar .over{fill:var(--bad)}.bar .limit{fill:var(--ink)}
.figures{display:flex;flex-wrap:wrap;gap:22px 24px;align-items:flex-start;margin:14px 0}
figure{margin:0;break-inside:avoid}
figure svg,figure img{display:block;max-width:100%;height:auto}
figure.wide{width:100%}figure.half{width:calc(50% - 12px)}figure.third{width:calc(33.333% - 16px)}
figcaption{font-size:13px;line-height:1.4;color:var(--soft);margin-top:6px}
svg.plot text{font-family:var(--sans)}
svg.map text{font:12px var(--sans);fill:#3a424c}
svg.map path{stroke:#5b6470;fill:none;stroke-width:.8}
svg.map .frame{fill:none;stroke:#5b6470;stroke-width:.8}
.frames{display:grid;grid-template-columns:repeat(6,1fr);gap:14px 12px;margin:14px 0}
.frames img{width:100%;border:1px solid var(--line)}
.frames figcaption{margin-top:3px;font-size:12.5px}
.artefact{break-inside:avoid;margin-top:30px;border-top:1px solid var(--line);padding-top:14px}
.artefact h3{margin:0 0 4px;display:flex;justify-content:space-between;gap:20px}
.artefact h3 .mark{font:600 14px var(--sans)}
.columns{display:flex;flex-wrap:wrap;gap:0 48px;align-items:flex-start}
.columns>div{flex:1 1 400px;min-width:0}.frames,.compare{break-inside:avoid}
.small td,.small th{font-size:13px;padding-top:4px;padding-bottom:4px}
.hash{font-family:ui-monospace,"DejaVu Sans Mono",monospace;font-size:11.5px;overflow-wrap:anywhere}
.empty{color:var(--soft);font-style:italic}
@media screen and (max-width:760px){main{padding:22px 18px;margin:0}.lines{columns:1;margin-left:0}
figure.half,figure.third{width:100%}.frames{grid-template-columns:repeat(3,1fr)}section,main{overflow-x:auto}}
@page{size:A4;margin:16mm 15mm 18mm}
@media print{html{background:#fff}body{font-size:9.6pt;line-height:1.42}
main{max-width:none;margin:0;padding:0;box-shadow:none}nav{display:none}
h1{font-size:21pt}h2{font-size:14.5pt}h3{font-size:11pt}h2,h3{break-after:avoid}
.overall p{font-size:13pt}section{margin-top:9mm}#alignment,#artefacts{break-before:page;margin-top:0}
table{font-size:8.6pt}thead th{font-size:7.8pt}thead{display:table-header-group}tr{break-inside:avoid}
th,td{padding-right:7px}.note,figcaption{font-size:8pt}.lines,.facts,.virtual{font-size:8.8pt}.bar{width:52px}
.small td,.small th{font-size:8pt}.figures{gap:4mm 5mm;margin:2.5mm 0}.columns{gap:0 7mm}.columns>div{flex-basis:0}
.frames{gap:3mm 3mm}.artefact{margin-top:5mm;padding-top:2.5mm}.artefact h3 .mark{font-size:9pt}.artefact .figures{margin:1mm 0}
.artefact .small td,.artefact .small th{padding-top:1.5px;padding-bottom:1.5px}#fringes,#phase,#models,#provenance{break-inside:avoid}figure.half{width:calc(50% - 2.6mm)}
figure.third{width:calc(33.333% - 3.4mm)}.hash{font-size:7pt}a{color:inherit;text-decoration:none}}
)css";

}  // namespace

std::string page(std::string_view title, const Markup& body) {
  const Markup head = Markup::trusted(
                          "<meta charset=\"utf-8\">\n"
                          "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n") +
                      element("title", text(title)) + Markup::trusted("\n<style>") + Markup::trusted(kStyle) +
                      Markup::trusted("</style>");
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n" + head.html() + "\n</head>\n<body>\n" +
         element("main", body).html() + "\n</body>\n</html>\n";
}

}  // namespace fringecal::reports
