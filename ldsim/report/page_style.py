"""The style sheet of the report's page."""

STYLE = """
:root{--paper:#fcfbf8;--ink:#23282f;--soft:#5f6872;--line:#dfdcd3;--card:#f4f1ea;--full:#7a828c;--linear:#1f83c4;
--latent:#d55e00;--alarm:#a8321a;--alarm-card:#fbece5;color-scheme:light dark}
@media (prefers-color-scheme:dark){:root{--paper:#15171b;--ink:#dfe3e8;--soft:#98a1ab;--line:#2f343b;--card:#1d2025;
--alarm:#ff9a78;--alarm-card:#33201a}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);line-height:1.55;font-size:1rem;
font-family:system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif;-webkit-text-size-adjust:100%}
main{max-width:68rem;margin:0 auto;padding:3.5rem 1.5rem 5rem}
h1,h2,.lede,.key dd:first-of-type{font-family:'Iowan Old Style','Palatino Linotype',Palatino,
'Book Antiqua',Georgia,serif;font-weight:500}
h1{font-size:clamp(2.4rem,7vw,4rem);line-height:1.05;margin:.1em 0 .25em;letter-spacing:-.015em;overflow-wrap:anywhere}
h2{font-size:1.55rem;line-height:1.2;margin:0 0 .7rem}
a{color:inherit;text-underline-offset:.2em}
.kicker{margin:0;color:var(--soft);font-size:.85rem}
.kicker::before{content:"";display:inline-block;width:2.2rem;height:.5rem;margin-right:.7rem;border-radius:1px;
background:linear-gradient(90deg,var(--full) 0 33%,var(--linear) 33% 67%,var(--latent) 67%)}
.lede{font-size:1.3rem;line-height:1.45;max-width:38rem;margin:0 0 2.2rem}
p{max-width:42rem;margin:.5rem 0}
.note{color:var(--soft);font-size:.9rem}
data{font-variant-numeric:tabular-nums;white-space:nowrap}
.null{color:var(--soft)}
dl,dd{margin:0}
.key{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,15rem),1fr));border-block:1px solid var(--line)}
.key>div{padding:1.1rem 1.4rem 1.2rem}
.key>div:first-child{padding-left:0}
.key>div+div{border-left:1px solid var(--line)}
.key dt{color:var(--soft);font-size:.9rem}
.key dd:first-of-type{font-size:2.5rem;line-height:1.2}
.key>div:first-child dd:first-of-type{color:var(--latent)}
.key .remark{font-size:.87rem;color:var(--soft);max-width:20rem}
section{margin-top:3.6rem}
.warnings{margin-top:2rem;padding:1.2rem 1.5rem;background:var(--alarm-card);
border-left:.3rem solid var(--alarm);border-radius:2px}
.warnings h2{font-size:1.2rem;color:var(--alarm);margin-bottom:.4rem}
.warnings ul{margin:0;padding-left:1.1rem;max-width:46rem}
.warnings li{margin:.3rem 0}
.calm{margin-top:1.6rem;color:var(--soft)}
.pictures{margin-top:2.4rem}
.replay{margin-top:2.4rem;--shadow:.25 .28 .32 .2}
.stage{position:relative;border:1px solid var(--line);border-radius:3px;background:var(--card)}
.canvas{display:block;width:100%;height:clamp(17rem,34vw,26rem);touch-action:pan-y;cursor:grab}
.canvas:active{cursor:grabbing}
.canvas:focus-visible,.controls :focus-visible,.plot:focus-visible{outline:2px solid var(--linear);outline-offset:2px}
.panels{position:absolute;inset:0;display:grid;grid-auto-flow:column;grid-auto-columns:1fr;pointer-events:none}
.panel{padding:.5rem .8rem;font-size:.85rem;line-height:1.35}
.panel+.panel{border-left:1px solid var(--line)}
.panel b{font-weight:600}
.panel span{display:block;color:var(--soft);font-variant-numeric:tabular-nums}
.pulls{position:absolute;inset:0;width:100%;height:100%;pointer-events:none}
.pulls line{stroke:var(--ink);stroke-width:1.5}
.pulls circle{fill:var(--ink)}
.controls{display:flex;flex-wrap:wrap;gap:.5rem 1.1rem;align-items:center;margin:.7rem 0 .4rem;font-size:.9rem}
.controls label{color:var(--soft)}
.controls button,.controls select{min-height:2.2rem;padding:.2rem .8rem;font:inherit;color:var(--ink);
background:var(--paper);border:1px solid var(--soft);border-radius:4px;cursor:pointer}
.controls .play{min-width:5rem}
.controls .scrub{flex:1 1 10rem;accent-color:var(--latent)}
.controls .time{min-width:4rem;text-align:right;font-variant-numeric:tabular-nums}
.key-bar{color:var(--soft);font-size:.85rem;margin:0}
.bar{display:inline-block;width:7rem;height:.6rem;margin:0 .3rem;border-radius:1px}
figure{margin:0 0 1.8rem}
img{display:block;width:100%;height:auto}
.picture .scroll{margin:0}
.picture img{min-width:42rem}
figcaption{color:var(--soft);font-size:.9rem;margin-top:.5rem}
.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,20rem),1fr));column-gap:2.5rem;
margin-bottom:.9rem}
.facts>div{display:flex;justify-content:space-between;gap:1rem;padding:.42rem 0;border-bottom:1px solid var(--line)}
.facts dt{color:var(--soft)}
.facts dd{text-align:right;overflow-wrap:anywhere}
code{font-family:ui-monospace,'SF Mono',Menlo,Consolas,monospace;font-size:.9em}
.scroll{overflow-x:auto;margin:1rem 0 .8rem}
.scroll:focus-visible{outline:2px solid var(--linear);outline-offset:3px}
table{border-collapse:collapse;width:100%;font-size:.92rem;font-variant-numeric:tabular-nums}
caption{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%)}
th,td{padding:.5rem .75rem;text-align:right;vertical-align:baseline;border-bottom:1px solid var(--line)}
th:first-child{padding-left:0;text-align:left;white-space:nowrap;position:sticky;left:0;background:var(--paper)}
td{white-space:nowrap}
td:last-child,thead th:last-child{padding-right:0}
tbody th{font-weight:500}
thead th{color:var(--soft);font-weight:400;font-size:.82rem;line-height:1.3;vertical-align:bottom;
white-space:normal;border-bottom-color:var(--soft)}
.own>*{background:var(--card)}
.own th:first-child{background:var(--card);box-shadow:-.6rem 0 0 var(--card)}
small{color:var(--soft)}
.space::before{content:"";display:inline-block;width:.62em;height:.62em;margin-right:.55em;border-radius:2px;
background:var(--full)}
.space.linear::before{background:var(--linear)}
.space.latent::before{background:var(--latent)}
.bad{color:var(--alarm);font-weight:600}
.plots{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,26rem),1fr));gap:2rem 2.5rem;
margin-top:1.6rem;align-items:end}
.plot svg{display:block;width:100%;max-width:34rem;height:auto}
.live{position:relative;border-radius:2px}
.live svg{touch-action:pan-y;cursor:crosshair;user-select:none;-webkit-user-select:none}
.choice{fill:var(--linear);fill-opacity:.15;stroke:var(--linear);stroke-width:.7}
.dot{fill:var(--paper);stroke:currentColor;stroke-width:1.6;pointer-events:none}
.told{position:absolute;z-index:1;max-width:17rem;padding:.3rem .6rem;font-size:.82rem;line-height:1.4;
background:var(--card);border:1px solid var(--soft);border-radius:3px;pointer-events:none}
.whole{position:absolute;right:0;top:100%;padding:.15rem .6rem;font:inherit;font-size:.82rem;color:var(--ink);
background:var(--card);border:1px solid var(--soft);border-radius:3px;cursor:pointer}
@media (prefers-color-scheme:dark){.replay{--shadow:0 0 0 .4}}
@media screen{.replay:not([hidden])~.pictures .moving{display:none}}
@media (max-width:40rem){main{padding:2rem 1.1rem 3rem}section{margin-top:2.6rem}.lede{font-size:1.15rem}
.canvas{height:min(38rem,78vh)}.panels{grid-auto-flow:row;grid-auto-rows:1fr}
.panel+.panel{border-left:0;border-top:1px solid var(--line)}.key>div{padding:.9rem 0}
.key>div+div{border-left:0;border-top:1px solid var(--line)}}
@media print{:root{--paper:#fff;--ink:#000;--soft:#444;--line:#bbb;--card:#f2f2f2;--alarm:#a8321a;--alarm-card:#fff}
.replay{display:none}.told,.dot,.whole{display:none!important}
main{max-width:none;padding:0}section{margin-top:1.6rem}.plot,figure,tr{break-inside:avoid}h2{break-after:avoid}
.scroll{overflow:visible}.picture img{min-width:0}table,thead th{font-size:.66rem}th,td{padding:.3rem .25rem}}
"""
