"use strict";
// Sorting and copying. The page is complete without this script: it adds the buttons it serves.
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

  // Text as programs read it: a hyphen for the minus sign, no space between thousands.
  const plain = (element) => element.textContent
    .replace(/(\d)\u202f(?=\d{3})/g, "$1").replace(/[\u202f\u00a0]/g, " ").replace(/\u2212/g, "-")
    .replace(/\s+/g, " ").trim();

  // Where the page is not a secure context, the selection of a text field can still be copied.
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
    say(done ? `${what} copied.` : `${what} could not be copied: select it and copy it by hand.`);
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

  // The cells of a row, one for each column: a cell that spans several stands in each of them.
  const columns = (row) => [...row.cells].flatMap((cell) => Array(cell.colSpan).fill(cell));
  const number = (cell) => {
    const text = cell.dataset.value ?? plain(cell).replace(/ ?%$/, "");
    return text === "" ? NaN : Number(text);
  };
  const order = (first, second) => {
    const [a, b] = [number(first), number(second)];
    if (!Number.isNaN(a) && !Number.isNaN(b)) return a - b;
    if (Number.isNaN(a) !== Number.isNaN(b)) return Number.isNaN(a) ? 1 : -1;
    return plain(first).localeCompare(plain(second), "en", { numeric: true });
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

  for (const table of document.querySelectorAll("table")) {
    const head = columns(table.tHead.rows[table.tHead.rows.length - 1]);
    const caption = table.dataset.name;
    head.forEach((cell, index) => {
      if (cell.tagName !== "TH") return;
      const sort = document.createElement("button");
      sort.type = "button";
      sort.className = "sort";
      sort.append(...cell.childNodes);
      cell.append(sort);
      sort.addEventListener("click", () => {
        const falling = cell.getAttribute("aria-sort") === "ascending";
        const rows = [...table.tBodies[0].rows];
        // What has no number stays at the end either way.
        rows.sort((first, second) => {
          const [a, b] = [columns(first)[index], columns(second)[index]];
          const missing = Number.isNaN(number(a)) !== Number.isNaN(number(b));
          return falling && !missing ? order(b, a) : order(a, b);
        });
        head.forEach((other) => other.removeAttribute("aria-sort"));
        cell.setAttribute("aria-sort", falling ? "descending" : "ascending");
        table.tBodies[0].append(...rows);
        say(`${caption} sorted by ${cell.dataset.head ?? plain(cell)}, ${falling ? "falling" : "rising"}.`);
      });
    });
    const tools = document.createElement("p");
    tools.className = "tools";
    tools.append(button("Copy table", (own) => copy(asText(table, head), own, caption)));
    tools.firstChild.setAttribute("aria-label", `Copy table: ${caption}`);
    table.closest(".scroll").after(tools);
  }
})();
