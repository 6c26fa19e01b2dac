"use strict";

const STATE_EVERY_MS = 200;
const PICTURE_EVERY_MS = 60;
const AGAIN_MS = 1000;
const PATIENCE_MS = 5000;

const byId = (id) => document.getElementById(id);
const ask = (path) => fetch(path, { signal: AbortSignal.timeout(PATIENCE_MS) });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const dash = (value, write) => (value === null || value === undefined ? "–" : write(value));

function put(id, text) {
  const node = byId(id);
  if (node.textContent !== text) node.textContent = text;
}

function figure(id, number, unit, more, alarm = false) {
  const node = byId(id);
  node.replaceChildren(number, Object.assign(document.createElement("small"), { textContent: ` ${unit}` }));
  node.closest(".tile").classList.toggle("alarm", alarm);
  put(`${id}-more`, more);
}

function lasting(seconds) {
  const s = Math.floor(seconds), parts = [Math.floor(s / 3600), Math.floor(s / 60) % 60, s % 60];
  return parts.map((part) => String(part).padStart(2, "0")).join(":");
}

function health(state, reason) {
  document.body.dataset.state = state;
  put("state", state);
  put("reason", reason ?? "");
}

function show(state, fan) {
  health(state.health.state, state.health.reason);
  put("speed", dash(state.speed_m_s, (v) => `${v.toFixed(1)} m/s`));
  put("uptime", lasting(state.uptime_s));
  put("lens", dash(state.lens, (lens) => (lens.denied ? "denied by its turns" : lens.agrees ? lens.says : "not settled")));
  byId("lens").title = state.lens?.says ?? "its turns were not judged yet";
  const distrusted = state.age.distrusted ? `: ${state.age.distrusted}` : "";
  const source = state.age.from === "sender" ? "since capture, sender's clock" : `since reception${distrusted}`;
  const p95 = dash(state.age.p95_ms, (ms) => `95 % under ${ms.toFixed(0)} ms`);
  figure("age", dash(state.age.ms, (ms) => ms.toFixed(0)), "ms", `${p95}, ${source}`, state.age.p95_ms > 200);
  figure("fps", state.fps.out.toFixed(1), "/ s", `${state.fps.in.toFixed(1)} / s received, ${state.reconnects} reconnects`);
  const reasons = Object.entries(state.frames.dropped);
  const dropped = reasons.reduce((sum, [, count]) => sum + count, 0);
  const share = state.frames.received ? 100 * dropped / state.frames.received : 0;
  const most = reasons.sort((a, b) => b[1] - a[1]).slice(0, 2);
  const why = most.length === 1 ? most[0][0] : most.map(([reason, count]) => `${count}: ${reason}`).join("; ");
  figure("dropped", String(dropped), `${share.toFixed(0)} %`, why || `of ${state.frames.received}`);
  const pairs = state.ranges.map((pair) => `${pair.displacement_m.toFixed(2)} m in ${pair.shift}`).join(", ");
  const unit = state.ranges.at(-1)?.shift === 1 ? "frame" : "frames";
  figure("ranges", String(state.ranges_in_use), state.ranges_in_use === 1 ? "range" : "ranges", pairs ? `${pairs} ${unit}` : "none flown yet");
  const heard = dash(state.telemetry.age_ms, (ms) => `newest ${ms.toFixed(0)} ms ago`);
  figure("telemetry", state.telemetry.hz.toFixed(0), "Hz", heard, state.telemetry.age_ms > 500);
  byId("no-depth").hidden = !state.no_depth;
  put("no-depth", state.no_depth ? `no depth: ${state.no_depth}` : "");
  showFan(state.fan, fan);
}

function showFan(told, fan) {
  document.body.dataset.obstacles = told ? "on" : "off";
  if (!told) {
    put("nearest", "off");
    put("nearest-where", "start with --obstacles");
    return;
  }
  fan.draw(told);
  const found = nearest(told);
  put("nearest", found ? `${found.m.toFixed(1)} m` : "–");
  put("nearest-where", found ? bearing(found.index, told.sectors.length) : none(told));
}

// Where no obstacle is known: because there is none, or because nothing is.
function none(told) {
  if (told.lacking) return told.lacking;
  return told.sectors.every((sector) => sector.kind === "unknown") ? "every direction is unknown" : "no obstacle known";
}

function showScale(scale) {
  const bar = byId("scale");
  bar.style.background = `linear-gradient(to right, ${scale.colours.join(", ")})`;
  for (const tick of scale.ticks) {
    const beyond = tick.m === scale.far_m ? "> " : tick.m === scale.near_m ? "< " : "";
    const label = Object.assign(document.createElement("span"), { textContent: `${beyond}${tick.m}` });
    label.style.left = `${100 * tick.position}%`;
    bar.append(label);
  }
  const meanings = { farther: "farther than it can tell", nearer: "nearer than it can tell", unknown: "unknown" };
  for (const [name, meaning] of Object.entries(meanings)) {
    const { ground, line, falling } = scale.hatches[name];
    const swatch = document.createElement("i");
    const angle = falling ? 45 : 135;
    swatch.style.background = `repeating-linear-gradient(${angle}deg, ${ground} 0 5px, ${line} 5px 6px)`;
    const item = document.createElement("li");
    item.append(swatch, meaning);
    byId("swatches").append(item);
  }
}

// One picture at a time: the next is asked for when this one is on the screen.
async function pictures(id) {
  const image = byId(id);
  let number = 0;
  for (;;) {
    try {
      const answer = await ask(`${id}.jpg?after=${number}`);
      if (answer.status === 200) {
        const before = image.src;
        image.src = URL.createObjectURL(await answer.blob());
        await image.decode();
        if (before) URL.revokeObjectURL(before);
        image.parentElement.style.aspectRatio = `${image.naturalWidth} / ${image.naturalHeight}`;
        number = Number(answer.headers.get("X-Number"));
        image.dataset.number = number;
        await pause(PICTURE_EVERY_MS);
      }
    } catch {
      number = 0;
      await pause(AGAIN_MS);
    }
  }
}

// What is shown is old: pictures and figures pale (page.css), and no sector stays free.
function unreachable(fan) {
  health("unreachable", "no answer: the run has ended, or the link is down; what is shown is old");
  if (!document.querySelector("#sectors g")) return;
  fan.forget();
  put("nearest", "–");
  put("nearest-where", "not known");
}

async function watch() {
  let fan = null;
  for (;;) {
    try {
      if (fan === null) {
        const scale = await (await ask("scale.json")).json();
        showScale(scale);
        fan = new Fan(byId("fan"), scale);
      }
      show(await (await ask("state.json")).json(), fan);
      await pause(STATE_EVERY_MS);
    } catch (error) {
      if (!(error instanceof TypeError || error instanceof DOMException)) console.error(error);
      unreachable(fan);
      await pause(AGAIN_MS);
    }
  }
}

watch();
pictures("input");
pictures("depth");
