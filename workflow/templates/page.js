"use strict";
// Sorting, filtering and copying. The page is complete without this script, which adds its own buttons.
(() => {
  const status = document.getElementById("status");
  const say = (words) => { status.textContent = words; };
  const button = (words, act) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = words;
    made.addEventListener("click", () => act(made));
    return made;
  };

  // Text for programs: a hyphen for the minus sign, no space between thousands.
  const plain = (element) => element.textContent
    .replace(/(\d)\u202f(?=\d{3})/g, "$1").replace(/[\u202f\u00a0]/g, " ").replace(/\u2212/g, "-")
    .replace(/\s+/g, " ").trim();

  // Without a secure context the selection of a text field can still be copied.
  const copyBySelection = (text) => {
    const field = document.createElement("textarea");
    field.value = text;
    field.readOnly = true;
    field.className = "off-page";
    field.setAttribute("aria-label", "Text to copy");
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  };
  const copy = async (text, pressed, what) => {
    let done = false;
    try {
      await navigator.clipboard.writeText(text);
      done = true;
    } catch {
      done = copyBySelection(text);
    }
    pressed.focus();
    say(done ? `${what} copied.` : `${what} could not be copied. Select the text and copy it by hand.`);
    const words = pressed.textContent;
    pressed.textContent = done ? "Copied" : "Not copied";
    pressed.disabled = true;
    setTimeout(() => { pressed.textContent = words; pressed.disabled = false; }, 1200);
  };

  for (const place of document.querySelectorAll("[data-copy-from]")) {
    for (const id of place.dataset.copyFrom.split(" ")) {
      const source = document.getElementById(id);
      const name = source.dataset.name;
      const made = button(name, (own) => copy(source.textContent, own, name));
      made.setAttribute("aria-label", `Copy ${name}`);
      place.append(" ", made);
    }
    place.hidden = false;
  }

  // The cells of a row, one for each column: a cell that spans several columns is repeated.
  const columns = (row) => [...row.cells].flatMap((cell) => Array(cell.colSpan).fill(cell));
  const number = (cell) => {
    const text = cell.dataset.value ?? plain(cell).replace(/ ?%$/, "");
    return text === "" ? NaN : Number(text);
  };
  const words = new Intl.Collator("en", { numeric: true });
  const order = (a, b) => {
    if (!Number.isNaN(a.number) && !Number.isNaN(b.number)) return a.number - b.number;
    if (Number.isNaN(a.number) !== Number.isNaN(b.number)) return Number.isNaN(a.number) ? 1 : -1;
    return words.compare(a.text, b.text);
  };

  const asText = (table, head) => {
    const lines = [head.flatMap((cell) => {
      const name = cell.dataset.head ?? plain(cell);
      return cell.dataset.error === undefined ? [name] : [name, `${name} standard error`];
    })];
    for (const row of table.tBodies[0].rows) {
      const seen = new Set();
      lines.push(columns(row).flatMap((cell, index) => {
        const value = seen.has(cell) ? "" : cell.dataset.value ?? plain(cell);
        seen.add(cell);
        return head[index].dataset.error === undefined ? [value] : [value, cell.dataset.error ?? ""];
      }));
    }
    return lines.map((cells) => cells.join("\t")).join("\n");
  };

  // What is sought in a row, in any case: all of several words, or a /regular expression/.
  const seeker = (sought) => {
    const [, pattern] = sought.match(/^\/(.+?)\/?$/) ?? [];
    const parts = pattern ? [pattern] : sought.split(/\s+/).filter(Boolean).map((word) => word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
    try {
      const found = parts.map((part) => new RegExp(part, "i"));
      return (text) => found.every((one) => one.test(text));
    } catch { return () => false; } // a pattern that is being written
  };
  // A row is shown that has what is sought, the chosen failed check and group, and a mode in the range.
  const filter = (place) => {
    const table = document.querySelector(`table[data-name="${place.dataset.filters}"]`);
    const rows = [...table.tBodies[0].rows].map((row) => ({
      row,
      text: plain(row),
      failed: row.dataset.failed ? row.dataset.failed.split("|") : [],
      group: row.dataset.group,
      modes: row.dataset.modes.split(" ").filter(Boolean).map(Number),
    }));
    const field = (name) => place.querySelector(`[data-filter="${name}"]`);
    const offer = (name, values) => {
      const counts = new Map();
      values.forEach((value) => counts.set(value, (counts.get(value) ?? 0) + 1));
      for (const [value, count] of [...counts].sort((one, other) => words.compare(one[0], other[0]))) {
        field(name).append(new Option(`${value} (${count})`, value));
      }
      field(name).closest("label").hidden = name === "group" ? counts.size < 2 || Math.max(...counts.values()) < 2 : !counts.size;
    };
    offer("failed", rows.flatMap((each) => each.failed));
    offer("group", rows.map((each) => each.group).filter(Boolean));
    const mark = () => {
      const sought = field("marked")?.value.trim() ?? "";
      const marked = seeker(sought);
      rows.forEach((each) => each.row.classList.toggle("marked", sought !== "" && marked(each.text)));
    };
    const apply = () => {
      mark();
      const sought = seeker(field("text").value.trim());
      const [failed, group] = [field("failed").value, field("group").value];
      const [from, to] = [field("from").value, field("to").value];
      const inRange = (mode) => (from === "" || mode >= Number(from)) && (to === "" || mode <= Number(to));
      let shown = 0;
      for (const each of rows) {
        each.row.hidden = !(
          sought(each.text)
          && (!failed || each.failed.includes(failed))
          && (!group || each.group === group)
          && ((from === "" && to === "") || each.modes.some(inRange))
        );
        shown += each.row.hidden ? 0 : 1;
      }
      place.querySelector("[data-shown]").textContent = shown < rows.length ? `${shown} of ${rows.length} shown` : "";
      say(`${shown} of ${rows.length} rows shown.`);
    };
    place.addEventListener("input", apply);
    place.hidden = false;
  };

  const save = (name, address) => {
    const link = document.createElement("a");
    link.download = name;
    link.href = address;
    link.click();
  };
  // What is seen of a table, as CSV.
  const asCsv = (table, head) => {
    const seen = [...table.rows].filter((row) => !row.hidden && row.cells.length);
    const quoted = (words) => `"${(/^[=+@\t\r-]/.test(words) && Number.isNaN(Number(words)) ? "'" : "") + words.replaceAll('"', '""')}"`;
    return seen.map((row) => {
      const cells = columns(row);
      return head.flatMap((title, at) => (title.hidden ? [] : [quoted(cells[at] === cells[at - 1] ? "" : cells[at]?.dataset[row.parentElement.tagName === "THEAD" ? "head" : "value"] ?? plain(cells[at]))])).join(",");
    }).join("\r\n");
  };
  // Checks by recording, of the rows that are seen and in their order; colours as of the verdicts.
  const OUTCOMES = { P: ["passed", "--figure-truth"], C: ["caution", "--figure-fifth"], F: ["failed", "--figure-error"], N: ["note", "--figure-muted"], J: ["not judged", "--rule"] };
  const heatMap = (table) => {
    const names = table.dataset.checks.split("|");
    const rows = [...table.tBodies[0].rows].filter((row) => !row.hidden && row.dataset.outcomes);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const [left, top, size] = [190, 230, 14];
    const make = (kind, attributes, words) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
      Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
      if (words !== undefined) made.textContent = words;
      return made;
    };
    const [width, height] = [left + size * names.length + 150, top + size * rows.length + 8];
    const svg = make("svg", { xmlns: "http://www.w3.org/2000/svg", width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Checks of ${rows.length} recordings`, "font-family": "sans-serif", "font-size": 11, fill: colour("--ink") });
    svg.append(make("rect", { width, height, fill: colour("--paper") }));
    Object.values(OUTCOMES).forEach(([words, role], at) => {
      svg.append(make("rect", { x: 4, y: 8 + 18 * at, width: 12, height: 12, fill: colour(role) }), make("text", { x: 22, y: 18 + 18 * at }, words));
    });
    names.forEach((name, at) => {
      const x = left + size * at + 10;
      svg.append(make("text", { x, y: top - 6, transform: `rotate(-60 ${x} ${top - 6})` }, name));
    });
    rows.forEach((row, at) => {
      const name = plain(row.cells[0]);
      svg.append(make("text", { x: left - 8, y: top + size * at + 11, "text-anchor": "end" }, name.length > 28 ? `${name.slice(0, 27)}…` : name));
      row.dataset.outcomes.trim().split(" ").forEach((each) => {
        const [words, role] = OUTCOMES[each.at(-1)];
        const cell = make("rect", { x: left + size * parseInt(each, 10), y: top + size * at, width: size - 2, height: size - 2, fill: colour(role) });
        if (words !== "passed") cell.append(make("title", {}, `${name}: ${names[parseInt(each, 10)]}, ${words}`));
        svg.append(cell);
        if (words === "failed") svg.append(make("text", { x: left + size * parseInt(each, 10) + 3, y: top + size * at + 10, "font-weight": 700, fill: colour("--paper") }, "×"));
      });
    });
    return svg;
  };
  const asPicture = (svg) => `data:image/svg+xml;charset=utf-8,${encodeURIComponent(new XMLSerializer().serializeToString(svg))}`;
  const asPng = (svg, done) => {
    const picture = new Image();
    picture.onload = () => {
      const canvas = document.createElement("canvas");
      const sharp = Math.min(2, 16000 / picture.height);
      [canvas.width, canvas.height] = [picture.width * sharp, picture.height * sharp];
      canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
      done(canvas.toDataURL());
    };
    picture.src = asPicture(svg);
  };
  // A row for each value of a column, of the rows that are seen: how many, and medians of their errors.
  const grouped = (table, head, at) => {
    const errors = head.flatMap((cell, place) => (cell.dataset.head?.endsWith("(%)") ? [place] : []));
    const members = new Map();
    for (const row of table.tBodies[0].rows) {
      const cell = columns(row)[at];
      const value = cell.colSpan > 1 ? "not complete" : plain(cell);
      if (!row.hidden) members.set(value, [...(members.get(value) ?? []), row]);
    }
    const median = (values) => {
      const known = values.filter(Number.isFinite).sort((a, b) => a - b);
      const middle = known[Math.floor((known.length - 1) / 2)] / 2 + known[Math.floor(known.length / 2)] / 2;
      return known.length ? Number(middle.toPrecision(3)) : "";
    };
    const medians = errors.map((place) => head[place].dataset.head.replace(" (%)", ", median (%)"));
    const names = [plain(head[at]), "Data sets", "With failed checks", ...medians];
    const made = document.createElement("table");
    const line = (section, scope, cells) => {
      const row = section.insertRow();
      cells.forEach((words, place) => {
        const cell = document.createElement(place && scope === "row" ? "td" : "th");
        if (cell.tagName === "TH") cell.scope = scope;
        else cell.dataset.label = names[place];
        cell.textContent = words;
        row.append(cell);
      });
    };
    line(made.createTHead(), "col", names);
    const body = made.createTBody();
    for (const [value, rows] of [...members].sort((one, other) => words.compare(one[0], other[0]))) {
      const sizes = errors.map((place) => median(rows.map((row) => number(columns(row)[place]))));
      line(body, "row", [value, rows.length, rows.filter((row) => row.dataset.failed).length, ...sizes]);
    }
    return made;
  };
  // Columns to hide, groups by a column, and the map of checks.
  const fleet = (table, head, tools) => {
    tools.append(" ", button("CSV", () => save("data_sets.csv", `data:text/csv;charset=utf-8,${encodeURIComponent(asCsv(table, head))}`)));
    const folded = (words) => {
      const made = document.createElement("details");
      made.append(document.createElement("summary"));
      made.firstChild.textContent = words;
      return made;
    };
    const shown = folded("Columns");
    head.slice(1).forEach((cell, at) => {
      const label = document.createElement("label");
      const box = document.createElement("input");
      box.type = "checkbox";
      box.checked = !cell.hidden;
      box.addEventListener("change", () => {
        for (const row of table.rows) {
          const own = columns(row)[at + 1];
          if (own?.colSpan === 1) own.hidden = !box.checked;
        }
      });
      label.append(box, " ", plain(cell).replace("↕", ""), " ");
      shown.append(label);
    });
    shown.className = "columns";
    const map = folded("Checks by recording");
    const region = (kind, label) => Object.assign(document.createElement("div"), { className: kind, tabIndex: 0, role: "region", ariaLabel: label });
    const place = region("scroll map", "Map of checks");
    const groups = folded("Groups");
    const choice = document.createElement("select");
    const complete = [...table.tBodies[0].rows].map(columns).filter((own) => own.at(-1).colSpan === 1);
    head.forEach((cell, at) => {
      // The names, errors, and what differs from each recording to the next, form no groups.
      const values = new Set(complete.map((own) => plain(own[at])));
      if (at && cell.tagName === "TH" && !cell.dataset.head && values.size < complete.length) choice.append(new Option(plain(cell), at));
    });
    const by = document.createElement("label");
    by.append("Group by ", choice);
    const saving = document.createElement("p");
    saving.className = "tools";
    const listed = region("scroll", "Groups");
    saving.append(button("CSV of groups", () => {
      const made = listed.firstChild;
      save("groups.csv", `data:text/csv;charset=utf-8,${encodeURIComponent(asCsv(made, [...made.rows[0].cells]))}`);
    }));
    groups.className = "columns";
    groups.append(by, listed, saving);
    const draw = () => {
      if (map.open) place.replaceChildren(heatMap(table));
      if (groups.open) listed.replaceChildren(grouped(table, head, Number(choice.value)));
    };
    groups.addEventListener("toggle", draw);
    const pictures = document.createElement("p");
    pictures.className = "tools";
    pictures.append(
      button("SVG", () => save("checks.svg", asPicture(place.firstChild))), " ",
      button("PNG", () => asPng(place.firstChild, (address) => save("checks.png", address))),
    );
    map.append(place, pictures);
    map.addEventListener("toggle", draw);
    document.addEventListener("input", () => setTimeout(draw));
    table.closest(".scroll").parentElement.addEventListener("click", (event) => { if (event.target.matches("button.sort")) draw(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    tools.after(shown, ...(choice.length ? [groups] : []), map);
  };

  // The name of its column on every cell, for narrow screens, where a row becomes a list.
  const label = (table, head) => {
    const names = head.map((cell) => cell.dataset.head ?? plain(cell));
    for (const row of table.tBodies[0].rows) {
      columns(row).forEach((cell, index) => { cell.dataset.label ??= names[index]; });
    }
    const narrow = matchMedia(`(max-width: ${table.dataset.stackBelow ?? 640}px)`);
    const stack = () => table.classList.toggle("stacked", narrow.matches);
    narrow.addEventListener("change", stack);
    stack();
  };

  for (const table of document.querySelectorAll("table")) {
    const head = columns(table.tHead.rows[table.tHead.rows.length - 1]);
    const caption = table.dataset.name;
    label(table, head);
    head.forEach((cell, index) => {
      if (cell.tagName !== "TH") return;
      const sort = document.createElement("button");
      sort.type = "button";
      sort.className = "sort";
      sort.append(...cell.childNodes);
      cell.append(sort);
      sort.addEventListener("click", () => {
        const descending = cell.getAttribute("aria-sort") === "ascending";
        // Each cell is read once, since a table may have thousands of rows.
        const rows = [...table.tBodies[0].rows].map((row) => {
          const at = columns(row)[index];
          return { row, number: number(at), text: plain(at) };
        });
        // Cells without a number come last in both directions.
        rows.sort((a, b) => {
          const missing = Number.isNaN(a.number) !== Number.isNaN(b.number);
          return descending && !missing ? order(b, a) : order(a, b);
        });
        head.forEach((other) => other.removeAttribute("aria-sort"));
        cell.setAttribute("aria-sort", descending ? "descending" : "ascending");
        table.tBodies[0].append(...rows.map((each) => each.row));
        say(`${caption} sorted by ${cell.dataset.head ?? plain(cell)}, ${descending ? "descending" : "ascending"}.`);
      });
    });
    const tools = document.createElement("p");
    tools.className = "tools";
    tools.append(button("Copy", (own) => copy(asText(table, head), own, caption)));
    tools.firstChild.setAttribute("aria-label", `Copy table: ${caption}`);
    table.closest(".scroll").after(tools);
    if (table.dataset.checks) fleet(table, head, tools);
  }

  document.querySelectorAll("[data-filters]").forEach(filter);

  // Shapes that move can be stopped, and stand still where the system asks for less motion.
  for (const place of document.querySelectorAll("details:has(animate)")) {
    let moves = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    const act = (made) => {
      place.querySelectorAll("svg").forEach((svg) => svg[moves ? "unpauseAnimations" : "pauseAnimations"]());
      made.textContent = moves ? "Stop" : "Move";
    };
    const tools = document.createElement("p");
    tools.className = "tools";
    tools.append(button("", (made) => { moves = !moves; act(made); }));
    act(tools.firstChild);
    place.append(tools);
  }

  // What is wider than its place says that it scrolls.
  const cue = (place) => {
    const told = place.previousElementSibling?.classList.contains("cue");
    const scrolls = place.clientWidth > 0 && place.scrollWidth > place.clientWidth + 1;
    place.classList.toggle("wider", scrolls);
    if (scrolls && !told) {
      const words = document.createElement("p");
      words.className = "cue";
      words.textContent = "Scroll sideways for more →";
      place.before(words);
    } else if (told) {
      place.previousElementSibling.hidden = !scrolls;
    }
  };
  const sizes = new ResizeObserver((entries) => entries.forEach((entry) => cue(entry.target)));
  document.querySelectorAll(".scroll").forEach((place) => sizes.observe(place));

  // The contents mark the part that is being read: the last one that begins above a third of the screen.
  const links = [...document.querySelectorAll(".contents a")];
  const parts = links.map((link) => document.querySelector(link.hash));
  const mark = () => {
    let current = parts.findLastIndex((part) => part.getBoundingClientRect().top < innerHeight / 3);
    if (innerHeight + scrollY >= document.documentElement.scrollHeight - 2) current = parts.length - 1;
    links.forEach((link, index) => {
      if (index === Math.max(current, 0)) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    });
  };
  if (links.length) {
    let waiting = false;
    addEventListener("scroll", () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => { waiting = false; mark(); });
    }, { passive: true });
    mark();
  }
})();
