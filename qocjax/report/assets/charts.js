// Charts: Plotly unpacked, each chart drawn when it is first seen or the browser is idle.

const charts = { config: { displaylogo: false, showSendToCloud: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] } };

charts.load = async () => {
  const packed = atob(document.getElementById("plotly").textContent);
  const bytes = new Uint8Array(packed.length);
  for (let k = 0; k < packed.length; k++) bytes[k] = packed.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
  if (!window.Plotly) throw new Error("the chart library did not start");
};

charts.draw = (place) => {
  const spec = page.data.charts[place.dataset.chart];
  if (!spec || place.classList.contains("drawn")) return;
  place.classList.add("drawn");
  if (spec.height) place.style.height = `${spec.height}px`;
  Plotly.newPlot(place, spec.data, spec.layout, charts.config);
  charts.scalable(place);
  place.on("plotly_relayout", () => charts.scalable(place));
  place.on("plotly_afterplot", () => charts.scalable(place));
  charts.readOut(place, spec);
  charts.views(place, spec);
  charts.legend(place);
};

// With a view box the drawing can be printed at another size than that of the screen.
charts.scalable = (place) => {
  const size = place._fullLayout;
  if (!size) return;
  place.style.setProperty("--ratio", String(size.width / size.height));
  for (const svg of page.all(".main-svg", place)) svg.setAttribute("viewBox", `0 0 ${size.width} ${size.height}`);
};

// What the pointer or the arrow keys are on, in words below the chart.
charts.readOut = (place, spec) => {
  const line = place.parentElement.querySelector(".readout");
  if (!line) return;
  const tell = (cell) => {
    if (!spec.symbol) {
      line.textContent = page.plain(cell[0]);
      return;
    }
    const [value, deadline, share, qoc, auc, distance, notes] = cell;
    line.textContent = page.plain(`${spec.symbol} = ${value}, Δ = ${deadline} ms, F(Δ) = ${share}: QoC ${qoc}, AUC ${auc} s, `
      + `smallest distance ${distance} m${notes}`);
  };
  place.on("plotly_hover", (event) => {
    const point = event.points.find((each) => each.customdata);
    if (point) tell(point.customdata);
  });
  if (!place.dataset.keys) return;
  const [xs, ys] = spec.grid;
  let column = 0, row = 0;
  const steps = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  place.addEventListener("keydown", (event) => {
    if (!(event.key in steps)) return;
    event.preventDefault();
    column = Math.min(Math.max(column + steps[event.key][0], 0), xs.length - 1);
    row = Math.min(Math.max(row + steps[event.key][1], 0), ys.length - 1);
    Plotly.Fx.hover(place, { xval: xs[column], yval: ys[row] });
    tell(spec.data[0].customdata[row][column]);
  });
  place.addEventListener("blur", () => Plotly.Fx.unhover(place));
};

charts.views = (place, spec) => {
  const names = Object.keys(spec.views ?? {});
  if (!names.length) return;
  const group = document.createElement("div");
  group.className = "views";
  names.forEach((name, k) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = name;
    button.setAttribute("aria-pressed", String(k === 0));
    button.addEventListener("click", () => {
      for (const each of group.children) each.setAttribute("aria-pressed", String(each === button));
      Plotly.relayout(place, spec.views[name]);
    });
    group.append(button);
  });
  place.parentElement.querySelector("figcaption").append(group);
  place.style.setProperty("--aside", `${group.offsetWidth + 8}px`);
};

charts.legend = (place) => {
  for (const button of page.all("[data-series]", place.parentElement)) {
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(on));
      const lines = place.data.flatMap((trace, k) => (trace.uid ?? "").startsWith(button.dataset.series) ? [k] : []);
      Plotly.restyle(place, { visible: on }, lines);
    });
  }
};

charts.start = async () => {
  const places = page.all("[data-chart]");
  if (!places.length) return;
  const resize = (root) => page.all(".drawn", root).forEach((place) => Plotly.Plots.resize(place));
  const ready = charts.load();
  for (const list of page.all("[role=tablist]")) {
    page.tabs(list, async (panel) => {
      await ready;
      page.all("[data-chart]", panel).forEach(charts.draw);
      resize(panel);
    });
  }
  await ready;
  const seen = (place) => !place.closest("[role=tabpanel]:not(.shown)");
  const idle = window.requestIdleCallback ?? ((work) => setTimeout(work, 30));
  const queue = [...places.filter(seen), ...places.filter((place) => !seen(place))];
  const next = () => {
    const place = queue.shift();
    if (!place) {
      document.documentElement.dataset.charts = "done";
      return;
    }
    charts.draw(place);
    idle(next);
  };
  next();
  window.addEventListener("beforeprint", () => places.forEach(charts.draw));
};

// After the first paint: tables and text are there at once.
requestAnimationFrame(() => setTimeout(() => charts.start().catch((error) => {
  page.trouble(`The charts could not be drawn (${error.message}); a browser of 2023 or later is needed. The tables hold the same numbers.`);
})));
