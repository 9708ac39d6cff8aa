"use strict";
// Figures to look into. Each is drawn from the CSV in its own link when it comes near the screen; the
// SVG stays for print, and for readers without a script.
(() => {
  const NEAR = "600px"; // a figure is drawn when it is that close to the screen
  const { button, draw, read, view, PER_HERTZ } = panels;
  const groups = new Map(); // plots with the same abscissa, by the name of their group
  const parts = new Map(); // what a group shows of its abscissa; null for the whole
  const drawn = new Map(); // plots and observers of each figure
  // Parts of a figure that are shown: at first where there is room for them.
  const shownParts = new Set(matchMedia("(min-width: 64rem)").matches ? ["phase", "coherence"] : []);
  const LARGE = 210; // pixels of a panel at least that stands alone in the place of many

  // Plots of one group show the same part of their abscissa.
  let following = false;
  const follow = (plot, scale) => {
    if (scale !== "x" || following || !plot.group) return;
    const { min, max } = plot.scales.x;
    const [low, high] = plot.whole;
    parts.set(plot.group, min > low || max < high ? [min, max] : null);
    following = true;
    for (const other of groups.get(plot.group) ?? []) {
      if (other !== plot) other.setScale("x", { min, max });
    }
    following = false;
  };

  const set = (plot, x, y) => plot.batch(() => {
    plot.setScale("x", { min: x[0], max: x[1] });
    if (plot.plane) plot.setScale("y", { min: y[0], max: y[1] });
  });
  const whole = (plot) => set(plot, plot.whole, plot.whole);
  // Parts of an axis, in decades where it has them.
  const range = (plot, axis) => {
    const inner = (value) => (plot.decades ? Math.log(value) : value);
    const { min, max } = plot.scales[axis];
    return { values: [min, max, ...plot.whole].map(inner), outer: (value) => (plot.decades ? Math.exp(value) : value) };
  };
  const zoom = (plots, factor) => {
    for (const plot of plots) {
      const [x, y] = (plot.plane ? ["x", "y"] : ["x", "x"]).map((axis) => {
        const { values: [min, max, low, high], outer } = range(plot, axis);
        const [middle, half] = [(min + max) / 2, ((max - min) / 2) * factor];
        return plot.plane && half > (high - low) / 2 ? plot.whole : [plot.plane ? middle - half : Math.max(low, middle - half), plot.plane ? middle + half : Math.min(high, middle + half)].map(outer);
      });
      set(plot, x, y);
    }
  };
  const shift = (plots, share) => {
    for (const plot of plots) {
      const { values: [min, max, low, high], outer } = range(plot, "x");
      const by = Math.min(Math.max(share * (max - min), low - min), high - max);
      const { min: bottom, max: top } = plot.scales.y;
      set(plot, [min + by, max + by].map(outer), [bottom, top]);
    }
  };
  // What was chosen in a plane, as a square.
  const square = (plot) => {
    const { left, top, width, height } = plot.select;
    if (width < 4 && height < 4) return;
    const half = Math.max(width, height) / 2;
    const edges = (middle, axis) => [middle - half, middle + half].map((at) => plot.posToVal(at, axis)).sort((a, b) => a - b);
    set(plot, edges(left + width / 2, "x"), edges(top + height / 2, "y"));
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  };

  // Gains with the phases and coherences that their table has, of the same rows.
  const withParts = (gains, { phase_deg: phases, coherence, input }) => {
    const of = (part, height, y_label, panel, curves, limits) => curves.length
      ? [{ ...panel, part, height, y_label, limits, marks: [], curves: curves.map((curve) => ({ ...curve, band: [] })) }] : [];
    const data = (curve) => !["noise", "distortion"].includes(curve.where?.[0][1]);
    const measured = (curve) => curve.where?.[0][1] === "measured";
    const label = new Set(input).size > 1 ? "Coherence with all inputs" : "Coherence";
    return gains.flatMap((panel) => [
      panel,
      ...(phases?.some(Boolean) ? of("phase", 110, "Phase (°)", { ...panel, scale: "phase" }, panel.curves.filter(data).map((curve) => ({ ...curve, column: "phase_deg", kind: "points", label: curve.label.replace(" with 95 % band", "") })), [-190, 190]) : []),
      ...(coherence?.some(Boolean) ? of("coherence", 90, label, { ...panel, scale: "linear" }, panel.curves.filter(measured).map((curve) => ({ ...curve, column: "coherence", label: "coherence" })), [0, 1.05]) : []),
    ]);
  };

  const open = (figure) => {
    const link = figure.querySelector("a[download]");
    const name = figure.dataset.name;
    const live = document.createElement("div");
    live.className = "live";
    live.setAttribute("role", "group");
    live.setAttribute("aria-label", `Figure: ${name}`);
    // On the first screen one channel or pair of channels is shown at a time, large.
    const table = read(link.href);
    const every = withParts(JSON.parse(figure.dataset.panels), figure.closest("#gain") ? table : {});
    const titles = figure.closest(".first-figures") ? [...new Set(every.map((panel) => panel.title ?? ""))] : [];
    const chosen = figure.dataset.chosen ?? titles[0];
    const wanted = every.filter((panel) => titles.length < 2 || (panel.title ?? "") === chosen)
      .map((panel) => (titles.length < 2 ? panel : { ...panel, title: "", height: panel.part ? panel.height : Math.max(panel.height, LARGE) }))
      .filter((panel) => !panel.part || shownParts.has(panel.part));
    const columns = titles.length ? 1 : Number(figure.dataset.columns);
    if (columns > 1) live.classList.add("grid");
    live.style.setProperty("--columns", figure.dataset.columns);
    figure.prepend(live);
    figure.classList.add("is-live");
    const linear = figure.dataset.linear === "true";
    const shown = wanted.map((panel, at) => {
      const below = columns === 1 && panel.linked && wanted[at + 1]?.x_label === panel.x_label;
      const [ofFrequency, toFrequency] = [panel.x_label, panel.y_label].map((label) => label?.includes("(Hz)"));
      const [per, perY] = [ofFrequency, toFrequency].map((is) => (is && view.radians ? PER_HERTZ : 1));
      return {
        ...panel,
        ofFrequency,
        toFrequency,
        below, // whether the next panel has the labels of the abscissa
        per,
        perY,
        levelled: panel.scale === "logarithmic",
        highest: panel.highest && panel.highest * per,
        x_label: per === 1 ? panel.x_label : panel.x_label.replace("(Hz)", "(rad/s)"),
        y_label: perY === 1 ? panel.y_label : panel.y_label.replace("(Hz)", "(rad/s)"),
        decades: panel.decades || (ofFrequency && view.decades),
        ...(linear && panel.scale === "logarithmic" ? { scale: "linear", limits: [] } : {}),
      };
    });
    const plots = shown.map((panel) => {
      const place = document.createElement("div");
      place.className = "panel";
      live.append(place);
      const plot = draw(panel, table, place, name, { follow, square, whole });
      if (panel.linked) {
        if (!groups.has(panel.linked)) groups.set(panel.linked, new Set());
        const mates = groups.get(panel.linked);
        mates.add(plot);
        // The whole range of a group is that of all its plots.
        const wholes = [...mates].map((one) => one.whole);
        const whole = [Math.min(...wholes.map(([low]) => low)), Math.max(...wholes.map(([, high]) => high))];
        for (const one of mates) one.whole = whole;
        const [min, max] = parts.get(panel.linked) ?? whole;
        plot.setScale("x", { min, max });
      }
      return plot;
    });
    const tools = document.createElement("p");
    tools.className = "zoom";
    // Plots that follow another one need no step of their own.
    const again = (chosen) => [close, open].forEach((act) => chosen.forEach(act));
    const toggle = (words, label, pressed, act) => {
      const named = `${words}: ${label}`;
      const made = button(words, named, () => {
        act();
        figure.querySelector(`[aria-label="${CSS.escape(named)}"]`).focus();
      });
      made.setAttribute("aria-pressed", String(pressed));
      return made;
    };
    // All figures over frequency change together.
    const frequencies = (key) => () => {
      view[key] = !view[key];
      parts.clear();
      again([...drawn.keys()].filter((each) => each.dataset.panels.includes("(Hz)") || each.dataset.panels.includes('"plane": "z"')));
    };
    if (titles.length > 1) {
      const choice = document.createElement("select");
      choice.setAttribute("aria-label", `Channel: ${name}`);
      titles.forEach((title) => choice.append(new Option(title, title, false, title === chosen)));
      choice.addEventListener("change", () => {
        figure.dataset.chosen = choice.value;
        again([figure]);
        figure.querySelector("select").focus();
      });
      tools.append(choice);
    }
    for (const part of new Set(every.map((panel) => panel.part).filter(Boolean))) {
      tools.append(toggle(part, name, shownParts.has(part), () => {
        shownParts[shownParts.has(part) ? "delete" : "add"](part);
        again([figure]);
      }));
    }
    const leaders = () => [...new Map(plots.map((plot, at) => [plot.group || at, plot])).values()];
    tools.append(
      button("←", `Move left: ${name}`, () => shift(leaders(), -0.25)),
      button("+", `Zoom in: ${name}`, () => zoom(leaders(), 0.5)),
      button("−", `Zoom out: ${name}`, () => zoom(leaders(), 2)),
      button("→", `Move right: ${name}`, () => shift(leaders(), 0.25)),
      button("↔", `Whole range: ${name}`, () => leaders().forEach(whole)),
    );
    if (shown.some((panel) => panel.ofFrequency || panel.toFrequency)) {
      tools.append(toggle("rad/s", `frequencies, ${name}`, view.radians, frequencies("radians")));
    }
    if (shown.some((panel) => panel.ofFrequency)) {
      tools.append(toggle("log f", `frequencies, ${name}`, view.decades, frequencies("decades")));
    }
    if (shown.some((panel) => panel.levelled)) {
      tools.append(toggle("linear", `ordinates, ${name}`, linear, () => {
        figure.dataset.linear = String(!linear);
        again([figure]);
      }));
    }
    live.prepend(tools);
    const observer = new ResizeObserver(() => {
      for (const plot of plots) {
        const width = plot.root.parentElement.clientWidth;
        if (width && width !== plot.width && !plot.plane) plot.setSize({ width, height: plot.height });
      }
    });
    observer.observe(live);
    drawn.set(figure, { plots, observer, live });
  };

  const close = (figure) => {
    const { plots, observer, live } = drawn.get(figure);
    observer.disconnect();
    for (const plot of plots) {
      groups.get(plot.group)?.delete(plot);
      plot.destroy();
    }
    live.remove();
    drawn.delete(figure);
  };

  const figures = document.querySelectorAll("figure[data-panels]");
  const near = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      near.unobserve(entry.target);
      open(entry.target);
    }
  }, { rootMargin: NEAR });
  figures.forEach((figure) => near.observe(figure));

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const figure of [...drawn.keys()]) {
      close(figure);
      open(figure);
    }
  });
})();
