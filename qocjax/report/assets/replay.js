// Replay: one drawing per policy, all at the same time. Lengths are centimetres, upwards is negative.

const replay = { scale: 100, trail: 3, fade: 300, holding: 100 };

replay.make = (parent, name, attributes = {}) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent.append(element);
  return element;
};

replay.decode = (steps, scale) => steps.map((each) => {
  let sum = 0;
  return Float64Array.from(each, (step) => (sum += step) / scale);
});

replay.run = (raw, end) => {
  const run = { ...raw };
  for (const name of ["x", "y", "heading", "rx", "ry"]) run[name] = replay.decode(raw[name], 1000);
  for (const name of ["age", "held"]) run[name] = replay.decode(raw[name], 1);
  run.times = Float64Array.from(run.x[0], (_, k) => Math.min(k * run.dt, end));
  run.times[run.times.length - 1] = end;
  return run;
};

// The frame before a time, and how far it is from there to the next.
replay.at = (run, time) => {
  const last = run.times.length - 1;
  const k = Math.min(Math.floor(time / run.dt + 1e-9), last);
  const next = Math.min(k + 1, last), length = run.times[next] - run.times[k];
  return [k, next, length > 0 ? Math.min((time - run.times[k]) / length, 1) : 0];
};

replay.between = (values, [k, next, share]) => values[k] + share * (values[next] - values[k]);

replay.points = (xs, ys, from, to) => {
  const parts = [];
  for (let k = from; k <= to; k++) parts.push(`${(replay.scale * xs[k]).toFixed(1)} ${(-replay.scale * ys[k]).toFixed(1)}`);
  return parts.length ? `M${parts.join("L")}` : "";
};

replay.hall = (place, data, run) => {
  const [left, right, bottom, top] = run.box, s = replay.scale;
  const svg = replay.make(place, "svg", {
    viewBox: `${s * left} ${-s * top} ${s * (right - left)} ${s * (top - bottom)}`, role: "img",
    "aria-label": `Robots in the hall under ${run.policy}`,
  });
  replay.make(svg, "rect", { class: "floor", x: s * left, y: -s * top, width: s * (right - left), height: s * (top - bottom) });
  for (let x = Math.ceil(left); x <= right; x++) replay.make(svg, "line", { class: "metre", x1: s * x, x2: s * x, y1: -s * top, y2: -s * bottom });
  for (let y = Math.ceil(bottom); y <= top; y++) replay.make(svg, "line", { class: "metre", y1: -s * y, y2: -s * y, x1: s * left, x2: s * right });
  if (data.map) {
    const [a, b, c, d] = data.map.extent;
    replay.make(svg, "image", { class: "map", href: data.map.png, x: s * a, y: -s * d, width: s * (b - a), height: s * (d - c), preserveAspectRatio: "none" });
  }
  const last = run.times.length - 1;
  run.rx.forEach((xs, k) => replay.make(svg, "path", { class: "reference", d: replay.points(xs, run.ry[k], 0, last) }));
  run.goals.forEach(([x, y]) => {
    const star = [...Array(10).keys()].map((k) => {
      const r = (k % 2 ? 0.45 : 1) * 1.3 * s * data.radius, angle = Math.PI * (k / 5 - 0.5);
      return `${s * x + r * Math.cos(angle)} ${-s * y + r * Math.sin(angle)}`;
    });
    replay.make(svg, "path", { class: "goal", d: `M${star.join("L")}Z` });
  });
  const robots = run.x.map((xs, k) => ({ path: replay.make(svg, "path", { class: "path", stroke: run.colours[k], d: replay.points(xs, run.y[k], 0, last) }) }));
  const now = run.rx.map(() => replay.make(svg, "path", { class: "now" }));
  for (const [name, kind] of [["disc", "circle"], ["trail", "path"], ["tether", "line"], ["ghost", "circle"], ["back", "circle"], ["body", "circle"], ["head", "line"]]) {
    robots.forEach((robot, k) => {
      const r = name === "disc" ? run.safe / 2 : name === "ghost" ? 0.55 * data.radius : data.radius;
      const look = name === "back" ? {} : name === "disc" || name === "body" ? { fill: run.colours[k], stroke: run.colours[k] } : { stroke: run.colours[k] };
      robot[name] = replay.make(svg, kind, { class: name, ...look, ...(kind === "circle" ? { r: s * r } : {}) });
    });
  }
  return { robots, now };
};

replay.ages = (place, data, run, most) => {
  const svg = replay.make(place, "svg", { viewBox: "0 0 1000 100", preserveAspectRatio: "none", "aria-hidden": "true" });
  const y = (age) => 96 - 92 * Math.min(age / most, 1);
  run.age.forEach((ages, k) => {
    const line = Array.from(ages, (age, i) => `${(1000 * run.times[i] / data.end).toFixed(1)} ${y(age).toFixed(1)}`);
    replay.make(svg, "path", { class: "age", stroke: run.colours[k], d: `M${line.join("L")}` });
  });
  const mark = y(1000 * run.deadline);
  replay.make(svg, "line", { class: "deadline", x1: 0, x2: 1000, y1: mark, y2: mark });
  const cursor = replay.make(svg, "line", { class: "cursor", y1: 0, y2: 100 });
  const text = document.createElement("p");
  const spans = [`age over time, 0 to ${most >= 1000 ? (most / 1000).toFixed(1) + " s" : Math.round(most) + " ms"}`, "dashed: Δ"];
  for (const each of spans) text.append(Object.assign(document.createElement("span"), { textContent: each }));
  place.append(text);
  return cursor;
};

replay.status = (place, data, run) => {
  const few = run.x.length <= 6, cell = (parent, kind = "span") => parent.appendChild(document.createElement(kind));
  const rows = few ? run.x.map((_, k) => {
    const name = cell(place), dot = cell(name);
    dot.className = "dot";
    dot.style.background = run.colours[k];
    name.append(`robot ${k + 1}`);
    return [cell(place), cell(place)];
  }) : [];
  const whole = cell(place, "div");
  whole.className = "whole";
  return { rows, whole };
};

replay.stage = (element, data, run, most) => ({
  run,
  hall: replay.hall(element.querySelector(".hall"), data, run),
  cursor: replay.ages(element.querySelector(".ages"), data, run, most),
  status: replay.status(element.querySelector(".status"), data, run),
});

replay.nearest = (xs, ys) => {
  let least = Infinity;
  for (let i = 0; i < xs.length; i++) for (let j = 0; j < i; j++) least = Math.min(least, Math.hypot(xs[i] - xs[j], ys[i] - ys[j]));
  return least;
};

replay.show = (stage, data, time) => {
  const { run, hall } = stage, place = replay.at(run, time), k = place[0], s = replay.scale;
  const xs = run.x.map((each) => replay.between(each, place)), ys = run.y.map((each) => replay.between(each, place));
  const near = (i) => xs.some((x, j) => j !== i && Math.hypot(x - xs[i], ys[j] - ys[i]) < run.safe);
  hall.robots.forEach((robot, i) => {
    const x = s * xs[i], y = -s * ys[i], heading = replay.between(run.heading[i], place);
    const held = run.held[i][k], waiting = k < run.waiting[i], from = Math.max(0, k - Math.ceil(replay.trail / run.dt));
    for (const name of ["disc", "back", "body"]) {
      robot[name].setAttribute("cx", x.toFixed(2));
      robot[name].setAttribute("cy", y.toFixed(2));
    }
    robot.disc.classList.toggle("near", near(i));
    robot.body.classList.toggle("held", waiting || held > replay.holding);
    robot.body.setAttribute("fill-opacity", waiting ? 0 : Math.max(0, 1 - held / replay.fade).toFixed(2));
    const reach = s * Math.max(run.safe / 2, 1.6 * data.radius);
    for (const [name, value] of [["x1", x], ["y1", y], ["x2", x + reach * Math.cos(heading)], ["y2", y - reach * Math.sin(heading)]]) robot.head.setAttribute(name, value.toFixed(2));
    const trail = replay.points(run.x[i], run.y[i], from, k);
    robot.trail.setAttribute("d", `${trail}L${x.toFixed(1)} ${y.toFixed(1)}`);
    const then = replay.at(run, Math.max(0, time - run.age[i][k] / 1000));
    const gx = s * replay.between(run.x[i], then), gy = -s * replay.between(run.y[i], then);
    robot.ghost.setAttribute("cx", gx.toFixed(2));
    robot.ghost.setAttribute("cy", gy.toFixed(2));
    for (const [name, value] of [["x1", x], ["y1", y], ["x2", gx], ["y2", gy]]) robot.tether.setAttribute(name, value.toFixed(2));
  });
  hall.now.forEach((diamond, i) => {
    const x = s * replay.between(run.rx[i], place), y = -s * replay.between(run.ry[i], place), r = 0.7 * s * data.radius;
    diamond.setAttribute("d", `M${x - r} ${y}L${x} ${y - r}L${x + r} ${y}L${x} ${y + r}Z`);
  });
  const at = (1000 * time / data.end).toFixed(1);
  stage.cursor.setAttribute("x1", at);
  stage.cursor.setAttribute("x2", at);
  replay.tell(stage, data, xs, ys, k);
};

replay.tell = ({ run, status }, data, xs, ys, k) => {
  const [left, right, bottom, top] = run.box, least = replay.nearest(xs, ys);
  status.rows.forEach(([age, state], i) => {
    const outside = xs[i] < left || xs[i] > right || ys[i] < bottom || ys[i] > top;
    age.textContent = `age ${Math.round(run.age[i][k])} ms`;
    const held = Math.round(run.held[i][k]);
    state.textContent = (k < run.waiting[i] ? "waits for its first command" : held > 0 ? `held for ${held} ms` : "new command")
      + (outside ? ", outside the view" : "");
  });
  const ages = run.age.map((each) => each[k]), mean = ages.reduce((a, b) => a + b, 0) / ages.length;
  const near = Number.isFinite(least) ? `nearest pair ${least.toFixed(3)} m` + (least < 2 * data.radius ? ", closer than two radii" : least < run.safe ? ", safety discs overlap" : "") : "";
  status.whole.textContent = status.rows.length ? near : `mean age ${Math.round(mean)} ms, largest ${Math.round(Math.max(...ages))} ms; ${near}`;
};

replay.start = () => {
  const data = page.data.replay;
  if (!data) return;
  const [slider, clock, button, sweep, speed] = ["time", "clock", "play", "replayed", "speed"].map((id) => document.getElementById(id));
  const runs = data.runs.map((raw) => replay.run(raw, data.end)), elements = page.all(".stage"), built = new Map();
  const chosen = () => elements.filter((each) => each.dataset.sweep === sweep.value);
  let time = replay.meeting(runs[0]), playing = false, before = 0, touched = false;
  slider.max = data.end;

  const draw = () => {
    slider.value = time;
    clock.textContent = `${time.toFixed(2)} s of ${Number(data.end.toPrecision(4))} s`;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
    for (const each of chosen()) replay.show(built.get(each), data, time);
  };
  const build = () => {
    const shown = chosen(), most = Math.max(...shown.flatMap((each) => runs[each.dataset.run].age.map((ages) => Math.max(...ages))));
    for (const each of elements) each.hidden = !shown.includes(each);
    for (const each of shown) if (!built.has(each)) built.set(each, replay.stage(each, data, runs[each.dataset.run], most));
    draw();
  };
  const go = (to) => {
    touched = true;
    time = Math.min(Math.max(to, 0), data.end);
    draw();
  };
  const tick = (stamp) => {
    if (!playing) return;
    time = Math.min(time + Number(speed.value) * Math.min(stamp - before, 100) / 1000, data.end);
    before = stamp;
    draw();
    if (time >= data.end) play(false); else requestAnimationFrame(tick);
  };
  const play = (on) => {
    playing = on;
    button.textContent = on ? "❚❚ Pause" : "▶ Play";
    if (!on) return;
    if (!touched || time >= data.end) time = 0;
    touched = true;
    requestAnimationFrame((stamp) => { before = stamp; tick(stamp); });
  };
  button.addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => go(Number(slider.value)));
  slider.addEventListener("keydown", (event) => {
    if (event.key !== " ") return;
    event.preventDefault();
    play(!playing);
  });
  sweep.addEventListener("change", build);
  for (const each of page.all(".ages")) each.addEventListener("click", (event) => {
    const box = each.querySelector("svg").getBoundingClientRect();
    go(data.end * (event.clientX - box.left) / box.width);
  });
  build();
};

// When robots of a run first come near one another, which is what one looks at first; or early on.
replay.meeting = (run) => {
  const near = (_, k) => replay.nearest(run.x.map((each) => each[k]), run.y.map((each) => each[k])) < 1.2 * run.safe;
  const first = run.times.findIndex(near);
  return run.times[first > 0 ? first : Math.floor(run.times.length / 8)];
};

replay.start();
