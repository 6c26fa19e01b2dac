"""The look of the report."""

STYLE = """
:root {
  color-scheme: light;
  --ink: #222b36;
  --soft: #5d6875;
  --line: #e3e7ec;
  --card: #fff;
  --ground: #f4f6f8;
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 16px/1.55 system-ui, sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 32px 20px 80px; }
header h1 { font-size: 34px; line-height: 1.2; margin: 8px 0 8px; letter-spacing: -.01em; }
header p { max-width: 74ch; color: var(--soft); margin: 8px 0; }
section {
  background: var(--card);
  border: 1px solid var(--line);
  border-radius: 12px;
  padding: 22px 26px;
  margin: 22px 0;
}
h2 { font-size: 21px; margin: 0 0 4px; }
h3 { font-size: 16px; margin: 18px 0 6px; }
section > p { color: var(--soft); max-width: 84ch; margin: 0 0 10px; }
table { border-collapse: collapse; width: 100%; font-size: 13.5px; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 9px; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { color: var(--soft); font-weight: 600; }
th:first-child, td:first-child { text-align: left; }
tbody tr:hover { background: #f4f8fc; }
.claims { table-layout: fixed; min-width: 700px; }
.claims td:nth-child(2) { white-space: normal; text-align: left; }
.claims th:nth-child(1) { width: 130px; }
.claims th:nth-child(3) { width: 110px; }
.claims th:nth-child(4) { width: 170px; }
.claims th:nth-child(5) { width: 120px; }
.wide { overflow-x: auto; }
.chip {
  display: inline-block;
  min-width: 96px;
  text-align: center;
  border-radius: 99px;
  padding: 1px 10px;
  font-size: 12.5px;
  font-weight: 600;
}
.holds { background: #dcf3e8; color: #0a6a4a; }
.fails { background: #fbe1df; color: #9c2219; }
.open { background: #eceff3; color: #55606d; }
.gallery { display: flex; gap: 12px; align-items: flex-start; }
.gallery > div { flex: 1; min-width: 0; }
.pictures { display: flex; flex-wrap: wrap; gap: 10px; margin: 8px 0 20px; }
figure { margin: 0; width: 116px; }
figure img { width: 116px; height: 116px; border-radius: 6px; display: block; }
figcaption { font-size: 12px; color: var(--soft); line-height: 1.3; margin-top: 4px; }
.scale { border-radius: 6px; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 4px 18px; font-size: 14px; }
dt { color: var(--soft); }
dd { margin: 0; overflow-wrap: anywhere; }
"""
