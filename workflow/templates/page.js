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

  // Filters of a table: a row is shown that contains all words of the search in any case, failed the
  // chosen check, belongs to the chosen group, and has a mode in the chosen range of frequencies.
  const filter = (place) => {
    const table = document.querySelector(`table[data-name="${place.dataset.filters}"]`);
    const rows = [...table.tBodies[0].rows].map((row) => ({
      row,
      text: plain(row).toLowerCase(),
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
      field(name).closest("label").hidden = counts.size < (name === "group" ? 2 : 1);
    };
    offer("failed", rows.flatMap((each) => each.failed));
    offer("group", rows.map((each) => each.group).filter(Boolean));
    const apply = () => {
      const sought = field("text").value.toLowerCase().split(/\s+/).filter(Boolean);
      const [failed, group] = [field("failed").value, field("group").value];
      const [from, to] = [field("from").value, field("to").value];
      const inRange = (mode) => (from === "" || mode >= Number(from)) && (to === "" || mode <= Number(to));
      let shown = 0;
      for (const each of rows) {
        each.row.hidden = !(
          sought.every((word) => each.text.includes(word))
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
  }

  document.querySelectorAll("[data-filters]").forEach(filter);

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
