"use strict";
// One panel of a figure, drawn from a table, with its curves, legend and cursor.
const panels = (() => {
  const COLOURS = ["ink", "muted", "grid", "model", "error", "truth", "fourth", "fifth"];
  const REACH = 24; // pixels from a click to the point that it tells
  const NORMAL_95 = 1.96;
  const CHI_SQUARE_95 = [3.841, 5.991]; // of one and two degrees of freedom
  const PER_HERTZ = 2 * Math.PI;
  const WHOLE = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]; // steps between whole numbers
  const view = { radians: false, decades: false }; // how all frequencies of the page are shown

  const colours = () => {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(
      COLOURS.map((role) => [role, style.getPropertyValue(`--figure-${role}`).trim()]),
    );
  };
  const fade = (colour, share) => {
    const [r, g, b] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    return `rgba(${r}, ${g}, ${b}, ${share})`;
  };

  // A cell with commas or quotes stands in quotes, in which quotes are doubled.
  const cells = (line) => [...line.matchAll(/("(?:[^"]|"")*"|[^,]*)(?:,|$)/g)]
    .slice(0, line.endsWith(",") ? undefined : -1)
    .map(([, cell]) => (cell.startsWith('"') ? cell.slice(1, -1).replaceAll('""', '"') : cell));
  const read = (address) => {
    const text = decodeURIComponent(address.slice(address.indexOf(",") + 1));
    const [head, ...rows] = text.trimEnd().split("\n").map((line) => (line.includes('"') ? cells(line) : line.split(",")));
    return Object.fromEntries(head.map((name, at) => [name, rows.map((row) => row[at])]));
  };
  const toNumber = (cell) => (cell === undefined || cell === "" ? null : Number(cell));

  const wrapped = (angle) => (angle === null ? null : ((((angle + 180) % 360) + 360) % 360) - 180);

  // One table [x, y, lower, upper] of a curve, by ascending x.
  const series = (own, panel, curve) => {
    const table = curve.source ? read(document.querySelector(`#${curve.source} a[download]`).href) : own;
    let rows = table[panel.x].map((_, at) => at);
    for (const [column, value] of curve.where ?? []) rows = rows.filter((at) => table[column][at] === value);
    const positive = (number) => (panel.scale === "logarithmic" && !(number > 0) ? null : number);
    const take = (name) => rows.map((at) => {
      const number = toNumber(table[name][at]);
      if (number === null) return null;
      return panel.scale === "phase" ? wrapped(number) : positive((curve.factor ?? 1) * panel.perY * number);
    });
    const x = rows.map((at) => {
      const number = toNumber(table[panel.x][at]);
      return number === null ? null : number * panel.per;
    });
    const y = take(curve.column);
    const inside = (at) => (!panel.highest || x[at] <= panel.highest) && (!panel.decades || x[at] > 0);
    const known = (at) => inside(at) && x[at] !== null && !Number.isNaN(x[at]) && table[curve.column][rows[at]] !== "";
    const order = x.map((_, at) => at).filter(known);
    // In a plane the points of a curve keep their order.
    if (panel.plane) return { 0: order.map((at) => x[at]), 1: order.map((at) => y[at]), table, rows: order.map((at) => rows[at]) };
    order.sort((a, b) => x[a] - x[b]);
    const sorted = [x, y, ...(curve.band ?? []).map(take)]
      .map((values) => order.map((at) => values[at]));
    return Object.assign(apart(sorted), { table, rows: order.map((at) => rows[at]) });
  };

  // Poles of several orders may have one frequency; an abscissa must not repeat.
  const apart = (columns) => {
    const x = columns[0];
    for (let at = 1; at < x.length; at += 1) {
      if (x[at] <= x[at - 1]) x[at] = x[at - 1] + Math.abs(x[at - 1] || 1) * 1e-12;
    }
    return columns;
  };

  const superscript = (digits) => [...String(digits)].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
  const show = (value, digits = 4) => {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e5)) {
      const [mantissa, power] = value.toExponential(digits - 1).split("e");
      return `${Number(mantissa)}·10${superscript(Number(power))}`.replace(/^-/, "−");
    }
    return String(Number(value.toPrecision(digits))).replace(/^-/, "−");
  };
  // Labels with as many digits as tell neighbours apart.
  const ticks = (values) => {
    for (let digits = 4; ; digits += 1) {
      const labels = values.map((value) => (value === null ? "" : show(value, digits).replace(/^1·/, "")));
      const words = labels.filter(Boolean);
      if (digits === 8 || new Set(words).size === words.length) return labels;
    }
  };

  // The value nearest to the cursor of a curve that shares the abscissa with others.
  const nearest = (values, at) => {
    for (let off = 0; off < 12; off += 1) {
      for (const place of [at - off, at + off]) {
        if (typeof values[place] === "number") return values[place];
      }
    }
    return null;
  };

  // Multiples of powers of ten in a range.
  const multiples = (_, axis, low, high) => {
    const values = [];
    for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1) {
      for (let digit = 1; digit < 10; digit += 1) values.push(Number(`${digit}e${power}`));
    }
    return values.filter((value) => value >= low && value <= high);
  };

  const PATHS = {
    line: () => undefined,
    points: () => () => null,
    stems: () => uPlot.paths.bars({ size: [0.5, 2, 1] }),
    steps: () => uPlot.paths.stepped({ align: 1 }),
  };

  const button = (words, label, act) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = words;
    if (label) {
      made.setAttribute("aria-label", label);
      made.title = label;
    }
    made.addEventListener("click", () => act(made));
    return made;
  };

  // What matplotlib draws at single points, and a page as well: intervals, ellipses, markers, names.
  const details = (plot, panel, curves, hidden, paint) => {
    const { ctx } = plot;
    const at = (x, y) => [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
    const trace = (points) => {
      ctx.beginPath();
      points.forEach(([x, y]) => ctx.lineTo(...at(x, y)));
    };
    const size = 4 * devicePixelRatio;
    curves.forEach(({ curve, table: { 0: xs, 1: ys, table, rows } }, number) => {
      if (hidden.has(number)) return;
      const colour = paint[curve.colour];
      ctx.strokeStyle = colour;
      ctx.fillStyle = fade(colour, 0.25);
      const cell = (name, k) => toNumber(table[name][rows[k]]);
      if (panel.plane && curve.kind !== "points") {
        trace(xs.map((x, k) => [x, ys[k]]));
        ctx.stroke();
        return;
      }
      xs.forEach((x, k) => {
        const y = ys[k];
        if (y === null) return;
        if (curve.errors) {
          const [along, across] = curve.errors.map((name, axis) => NORMAL_95 * (cell(name, k) ?? 0) * (axis ? 1 : panel.per));
          trace([[x - along, y], [x + along, y]]);
          ctx.stroke();
          trace([[x, panel.scale === "logarithmic" ? Math.max(y - across, 0.1 * y) : y - across], [x, y + across]]);
          ctx.stroke();
        }
        const [a, b, c] = (curve.ellipse ?? []).map((name) => cell(name, k));
        if (typeof a === "number" && typeof b === "number" && typeof c === "number") {
          const [half, turn] = [Math.hypot((a - b) / 2, c), Math.atan2(2 * c, a - b) / 2];
          const share = CHI_SQUARE_95[y === 0 ? 0 : 1];
          const [long, short] = [half, -half].map((part) => Math.sqrt(Math.max(share * ((a + b) / 2 + part), 0)));
          trace([...Array(49).keys()].map((step) => {
            const [p, q] = [long * Math.cos((step * Math.PI) / 24), short * Math.sin((step * Math.PI) / 24)];
            return [x + p * Math.cos(turn) - q * Math.sin(turn), y + p * Math.sin(turn) + q * Math.cos(turn)];
          }));
          ctx.fill();
          ctx.stroke();
        }
        const [left, top] = at(x, y);
        const word = curve.names && table[curve.names][rows[k]];
        if (word) {
          ctx.fillStyle = paint.ink;
          ctx.textAlign = "center";
          ctx.fillText(word, left, top - 2 * size);
          ctx.fillStyle = fade(colour, 0.25);
        }
        if (!panel.plane) return;
        ctx.beginPath();
        if (curve.marker === "x") {
          [1, -1].forEach((side) => {
            ctx.moveTo(left - size, top - side * size);
            ctx.lineTo(left + size, top + side * size);
          });
        } else ctx.arc(left, top, curve.marker === "." ? size / 3 : size, 0, 7);
        ctx.stroke();
      });
    });
    if (panel.plane !== "z") return;
    ctx.strokeStyle = paint.ink;
    trace([...Array(181).keys()].map((k) => [Math.cos((k * Math.PI) / 90), Math.sin((k * Math.PI) / 90)]));
    ctx.stroke();
    ctx.fillStyle = paint.muted;
    ctx.textAlign = "center";
    for (const share of [0.1, 0.2, 0.3, 0.4, 0.5]) {
      const [across, up] = [Math.cos(PER_HERTZ * share), Math.sin(PER_HERTZ * share)];
      const label = share * panel.rate * (view.radians ? PER_HERTZ : 1);
      ctx.fillText(show(label) + (share === 0.1 ? (view.radians ? " rad/s" : " Hz") : ""), ...at(1.14 * across, 1.14 * up + (share === 0.5 ? 0.1 : 0.03)));
    }
  };

  // `acts`: what follows a change of the abscissa, a choice in a plane, and a double click.
  const draw = (panel, table, place, name, acts) => {
    const paint = colours();
    const hidden = new Set(); // numbers of curves
    const heading = document.createElement("p");
    heading.className = "panel-title";
    const repeated = panel.title?.toLowerCase().includes(panel.y_label?.toLowerCase());
    heading.textContent = [panel.title, repeated ? "" : panel.y_label].filter(Boolean).join(": ");
    const legend = document.createElement("p");
    legend.className = "legend";
    const room = document.createElement("div");
    place.append(heading, legend, room);

    const tables = panel.curves.map((curve) => series(table, panel, curve));
    const [least, most] = panel.limits?.length === 2 ? panel.limits : [-1.3, 1.3];
    const data = panel.plane ? [[least, most], ...panel.curves.map(() => [null, null])] : uPlot.join(tables);
    const plotted = [{ label: panel.x_label }];
    const bands = [];
    const owners = []; // for each curve the numbers of its series
    panel.curves.forEach((curve) => {
      const colour = paint[curve.colour];
      const dots = curve.kind === "points";
      const band = panel.plane ? [] : curve.band ?? [];
      const first = plotted.length;
      plotted.push({
        label: curve.label,
        scale: curve.source ? "behind" : "y",
        stroke: colour,
        width: dots ? 0 : curve.colour === "muted" ? 1 : 1.6,
        dash: curve.dashed ? [6, 4] : undefined,
        fill: curve.kind === "stems" ? colour : undefined,
        paths: PATHS[curve.kind ?? "line"](),
        points: { show: dots || Boolean(curve.marker), size: panel.scale === "phase" ? 3 : dots ? 7 : 5, width: curve.marker?.startsWith("open") ? 1.5 : 0, fill: curve.marker?.startsWith("open") ? "transparent" : colour, stroke: colour },
      });
      band.forEach(() => plotted.push({ label: "", points: { show: false } }));
      if (band.length) {
        bands.push({ series: [first + 2, first + 1], fill: fade(colour, 0.25) });
      }
      owners.push([...Array(1 + band.length).keys()].map((at) => first + at));
    });

    const marks = (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.setLineDash([2, 4]);
      for (const mark of panel.marks ?? []) {
        ctx.strokeStyle = paint[mark.colour];
        const x = Math.round(plot.valToPos(mark.value * panel.per, "x", true));
        if (x < bbox.left || x > bbox.left + bbox.width) continue;
        ctx.beginPath();
        ctx.moveTo(x, bbox.top);
        ctx.lineTo(x, bbox.top + bbox.height);
        ctx.stroke();
      }
      for (const level of panel.levels ?? []) {
        ctx.strokeStyle = paint[level.colour];
        const y = Math.round(plot.valToPos(level.value, "y", true));
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
      }
      ctx.setLineDash([]);
      ctx.lineWidth = 1.4 * devicePixelRatio;
      ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      details(plot, panel, panel.curves.map((curve, number) => ({ curve, table: tables[number] })), hidden, paint);
      ctx.restore();
    };

    // Powers of ten, of many only as many as have room for their labels, of few with 2 and 5 between them.
    const decades = (_, splits) => {
      const [digits, powers] = [0, 1].map((part) => splits.map((value) => Number(value.toExponential().split("e")[part])));
      const count = digits.filter((digit) => digit === 1).length;
      const room = (panel.height - 50) / 18;
      const step = Math.max(1, Math.ceil(count / room));
      const labelled = 3 * count <= room ? [1, 2, 5] : [1];
      const shown = splits.map((value, at) => (labelled.includes(digits[at]) && powers[at] % step === 0 ? value : null));
      return shown.some((value) => value !== null) ? shown : splits;
    };
    const axis = (size, label) => ({
      ...(label ? { label, labelSize: 20, labelFont: "12px system-ui, sans-serif" } : {}),
      font: "12px system-ui, sans-serif",
      stroke: paint.ink,
      grid: { stroke: paint.grid, width: 1 },
      ticks: { stroke: paint.grid, width: 1, size: 4 },
      values: (_, values) => ticks(values),
      size,
      gap: 4,
    });
    const values = [];
    const cursor = (plot) => {
      const at = plot.cursor.idx;
      const { left, top } = plot.cursor;
      if (panel.plane) {
        where.textContent = left < 0 ? "" : `at ${show(plot.posToVal(left, "x"))}, ${show(plot.posToVal(top, "y"))}`;
        return;
      }
      where.textContent = at === null || at === undefined ? "" : `at ${show(plot.data[0][at])}`;
      values.forEach(({ out, number }) => {
        out.textContent = at === null || at === undefined ? "" : show(nearest(plot.data[number], at));
      });
    };
    const fixed = panel.limits?.length === 2;
    const [xAxis, yAxis] = [axis(30, panel.x_label), axis(58)];
    yAxis.space = Math.max(16, panel.height / 8); // also a small panel has two labels
    if (panel.below) Object.assign(xAxis, { label: undefined, labelSize: 0, size: 8, values: (_, splits) => splits.map(() => "") });
    if (panel.whole) xAxis.incrs = WHOLE;
    if (panel.counted) yAxis.incrs = WHOLE;
    if (panel.decades) xAxis.splits = multiples;
    if (panel.scale === "logarithmic") {
      yAxis.splits = multiples;
      yAxis.filter = decades;
      yAxis.grid.filter = decades;
      yAxis.ticks.filter = decades;
    }
    if (panel.scale === "phase") yAxis.splits = () => [-180, -90, 0, 90, 180];
    const yScale = panel.scale === "logarithmic" ? { distr: 3 } : {};
    if (fixed || panel.plane) yScale.range = [least, most];
    const width = Math.max(place.clientWidth, 160);
    const options = {
      width: panel.plane ? Math.min(width, 1.3 * panel.height) : width,
      height: panel.plane ? Math.min(width, 1.3 * panel.height) - 18 : panel.height,
      padding: [8, 18, 0, 0],
      legend: { show: false },
      cursor: { drag: { x: true, y: Boolean(panel.plane), setScale: !panel.plane }, bind: { dblclick: () => () => { acts.whole(plot); return null; } }, sync: panel.linked ? { key: panel.linked, scales: ["x", null] } : undefined },
      scales: { x: panel.decades ? { time: false, distr: 3, range: (_, low, high) => [Math.max(low, 1e-9), high] } : { time: false }, y: yScale, behind: { distr: 3 } },
      axes: [xAxis, yAxis],
      series: plotted,
      bands,
      hooks: { draw: [marks], setCursor: [cursor], setScale: [acts.follow], setSelect: panel.plane ? [acts.square] : [] },
    };
    const where = document.createElement("span");
    where.className = "where";
    const plot = new uPlot(options, data, room);
    const finite = data[0].filter((x) => x !== null);
    plot.plane = panel.plane;
    plot.decades = panel.decades;
    plot.whole = panel.highest ? [panel.decades ? finite[0] : 0, panel.highest] : [finite[0], finite.at(-1)];
    plot.group = panel.linked;
    if (panel.highest && !panel.linked) acts.whole(plot);
    plot.root.querySelector(".u-over").title = `${name}: drag to zoom, double-click for the whole range`;

    panel.curves.forEach((curve, at) => {
      const same = (number) => !panel.curves[number].label;
      if (same(at)) return;
      const numbers = [...owners[at]];
      for (let next = at + 1; next < owners.length && same(next); next += 1) numbers.push(...owners[next]);
      const swatch = document.createElement("i");
      swatch.className = curve.kind === "points" ? "dot" : curve.dashed ? "dash" : "";
      swatch.style.color = paint[curve.colour];
      const out = document.createElement("output");
      values.push({ out, number: owners[at][0] });
      const toggle = button("", "", (own) => {
        const shown = own.getAttribute("aria-pressed") !== "true";
        own.setAttribute("aria-pressed", String(shown));
        panel.curves.forEach((_, number) => {
          if (numbers.includes(owners[number][0])) hidden[shown ? "delete" : "add"](number);
        });
        numbers.forEach((number) => plot.setSeries(number, { show: shown }));
      });
      toggle.setAttribute("aria-pressed", "true");
      toggle.append(swatch, curve.label);
      const pair = document.createElement("span"); // a value stays beside its name
      pair.append(toggle, out);
      legend.append(pair);
    });
    const told = document.createElement("span");
    told.setAttribute("role", "status");
    legend.append(where, told);
    const say = (table, row) => {
      const words = Object.entries(table ?? {}).map(([column, values_]) => [column.replaceAll("_", " "), values_[row]]);
      told.textContent = words.filter(([, cell]) => cell !== "").map((pair) => pair.join(" ")).join(", ");
    };
    // The points that are shown, from left to right, with the row of the table that each stands for.
    const points = () => panel.curves.flatMap((curve, number) => {
      if (curve.kind !== "points" || hidden.has(number)) return [];
      const { 0: xs, 1: ys, table: own, rows } = tables[number];
      return ys.flatMap((y, at) => (y === null ? [] : [{ x: xs[at], y, table: own, row: rows[at] }]));
    }).sort((one, other) => one.x - other.x || one.y - other.y);
    // A click tells the row of the nearest point.
    const tell = ({ clientX, clientY }) => {
      const box = plot.over.getBoundingClientRect();
      let best = { away: REACH };
      for (const point of points()) {
        const across = plot.valToPos(point.x, "x") + box.left - clientX;
        const away = Math.hypot(across, plot.valToPos(point.y, "y") + box.top - clientY);
        if (away < best.away) best = { ...point, away };
      }
      say(best.table, best.row);
    };
    if (panel.curves.some((curve) => curve.kind === "points")) plot.over.addEventListener("click", tell);
    // Arrow keys go from point to point, or along the curves.
    plot.over.tabIndex = 0;
    plot.over.setAttribute("role", "group");
    plot.over.setAttribute("aria-label", `${[name, heading.textContent].filter(Boolean).join(", ")}: read with the arrow keys`);
    let reached = -1;
    plot.over.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!by) return;
      event.preventDefault();
      const stops = points();
      const { min, max } = plot.scales.x;
      const places = stops.length || panel.plane ? stops : plot.data[0].map((x) => ({ x }));
      const inside = places.filter(({ x }) => x >= min && x <= max);
      if (!inside.length) return;
      reached = Math.min(Math.max(reached + by * (event.shiftKey ? 10 : 1), 0), inside.length - 1);
      const { x, y, table: own, row } = inside[reached];
      plot.setCursor({ left: plot.valToPos(x, "x"), top: y === undefined ? 10 : plot.valToPos(y, "y") });
      say(own, row);
    });
    return plot;
  };

  return { button, draw, read, view, PER_HERTZ };
})();
