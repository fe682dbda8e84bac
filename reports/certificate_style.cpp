// The look of certificates and short reports: the reports' colours and type, set for A4 and for WeasyPrint 57 (no grid, no
// variables inside shorthands). Free CJK text falls back to Droid Sans Fallback.
#include "reports/certificate_html.h"

namespace fringecal::reports {

const char* const kCertificateStyle = R"css(
*{box-sizing:border-box}
html{background:#e9ecef}
body{margin:0;color:#1b1f24;font-family:"Liberation Sans",Arial,"DejaVu Sans","Droid Sans Fallback",sans-serif;
font-size:10.4pt;line-height:1.45}
main{max-width:190mm;margin:24px auto;padding:18mm 18mm 20mm;background:#fff}
h1,h2,h3{font-family:"Liberation Serif",Georgia,"DejaVu Serif","Droid Sans Fallback",serif;font-weight:bold;line-height:1.2;margin:0}
h1{font-size:26pt;margin-top:8mm}
h2{font-size:13.5pt;margin:0 0 2.6mm;padding-top:2.4mm;border-top:1.4pt solid #1b1f24}
h3{font-size:10.8pt;margin:4mm 0 1mm}
p{margin:0 0 2.2mm}
section{margin-top:6.5mm}
.letterhead{border-bottom:.6pt solid #b9c0c8;padding-bottom:2.6mm}
.laboratory{font-weight:bold;font-size:12pt;color:#0b5a7a}
.accreditation{font-size:9pt;color:#55606c}
.number{font-size:12.5pt;color:#55606c;margin:1.6mm 0 0}
.number b{color:#1b1f24}
.amendment{margin-top:2mm}
.test{margin:5mm 0 0;padding:2mm 4mm;border:1.6pt solid #a11f2a;color:#a11f2a;font-weight:bold;letter-spacing:.02em}
.facts{width:100%;border-collapse:collapse;margin:0 0 2mm}
.facts th{width:34mm;text-align:left;font-weight:normal;color:#55606c;vertical-align:top;padding:.6mm 3mm .6mm 0}
.facts td{vertical-align:top;padding:.6mm 0;overflow-wrap:anywhere}
.pair{width:100%;border-collapse:collapse}
.pair td.first{width:54%;padding-right:6mm}
.pair>tr>td,.pair>tbody>tr>td{vertical-align:top}
header+.pair{margin-top:6mm}
.label{color:#55606c;font-size:8.6pt}
.block{margin-top:.6mm}
.verdict{display:table}
.verdict .sign{display:table-cell;width:14mm;vertical-align:middle}
.verdict .overall{display:table-cell;vertical-align:middle;font-family:"Liberation Serif",Georgia,serif;font-weight:bold;font-size:13pt;line-height:1.3}
.conformity p{margin-top:2.4mm}
.signatures{width:100%;border-collapse:collapse;margin-top:1mm}
.signatures td{width:50%;vertical-align:bottom;padding:0 8mm 0 0;font-size:9.6pt}
.signatures .line{height:13mm;border-bottom:.6pt solid #1b1f24;margin-bottom:1.4mm;color:#55606c;font-size:8pt;line-height:1.3}
.signatures .electronic{height:auto;min-height:9mm;padding-bottom:1mm}
.authorisation{break-inside:avoid}
table.results,table.small{width:100%;border-collapse:collapse;font-size:8.8pt;line-height:1.3;margin:1mm 0 3mm}
thead{display:table-header-group}
tr{break-inside:avoid}
thead th{text-align:left;vertical-align:bottom;font-weight:bold;font-size:8pt;color:#55606c;border-bottom:1pt solid #1b1f24;padding:0 2.4mm 1.2mm 0}
tbody th{text-align:left;font-weight:normal}
table.results td,table.results tbody th,table.small td,table.small tbody th{vertical-align:top;border-bottom:.5pt solid #d9dde2;padding:1.3mm 2.4mm 1.3mm 0}
td.number,th.number{text-align:right;white-space:nowrap;padding-left:1mm;font-size:8.8pt;color:#1b1f24;margin:0}
thead th.number{text-align:right;font-size:8pt;color:#55606c}
table.results th:last-child,table.results td:last-child,table.small th:last-child,table.small td:last-child{padding-right:0}
table.results tbody th{color:#55606c;width:7mm}
.sub{display:block;color:#55606c;font-size:8.2pt}
.good{font-weight:bold;color:#1d6b3c}
.bad{font-weight:bold;color:#a11f2a}
.open{font-weight:bold}
figure{margin:4mm 0 0;break-inside:avoid}
figure svg{width:100%;height:auto}
figcaption{font-size:8.2pt;color:#55606c;margin-top:1.2mm}
ul{margin:0 0 2mm;padding-left:5mm}
.free{white-space:pre-wrap;overflow-wrap:anywhere}
.keep{break-inside:avoid}
.unbroken{white-space:nowrap}
.hash{font-size:7.4pt;color:#55606c;margin-bottom:.8mm}
.end{break-before:avoid;margin-top:7mm;text-align:center;color:#55606c;border-top:.6pt solid #b9c0c8;padding-top:2.4mm}
h2,h3{break-after:avoid}
@media screen{.running-laboratory,.running-title,.running-test{display:none}table{overflow-x:auto}}
@page{size:A4;margin:21mm 20mm 22mm;
@top-left{content:element(laboratory);font-family:"Liberation Sans",sans-serif;font-size:8pt;color:#55606c;vertical-align:bottom;padding-bottom:4mm}
@top-right{content:element(title);font-family:"Liberation Sans",sans-serif;font-size:8pt;color:#55606c;vertical-align:bottom;padding-bottom:4mm;text-align:right}
@bottom-left{content:element(test);vertical-align:top;padding-top:4mm}
@bottom-right{font-family:"Liberation Sans","Droid Sans Fallback",sans-serif;font-size:8pt;color:#55606c;vertical-align:top;padding-top:4mm}}
@page:first{margin-top:16mm;@top-left{content:none}@top-right{content:none}}
@media print{html{background:#fff}main{max-width:none;margin:0;padding:0}
body{font-size:9.4pt}.new-page{break-before:page;margin-top:0}
.running-laboratory{position:running(laboratory)}.running-title{position:running(title);text-align:right}
.running-test{position:running(test);color:#a11f2a;font-weight:bold;font-size:8pt}}
)css";

}  // namespace fringecal::reports
