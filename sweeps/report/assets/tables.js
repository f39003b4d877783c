"use strict";
// Tables that a click, or Enter on a heading's button, sorts; numbers by value, intervals by their
// lower bound, NA last.
for (const table of document.querySelectorAll("table.sortable")) {
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => {
      const down = heading.getAttribute("aria-sort") === "ascending";
      const key = row => {
        const cell = row.cells[column];
        const text = cell.dataset.value ?? cell.textContent.trim();
        const number = text === "" ? NaN : Number(text.split(" to ")[0]);
        return Number.isNaN(number) ? text : number;
      };
      const missing = value => value === "NA" || value === "";
      const order = (a, b) => {
        if (missing(a) || missing(b)) return missing(a) - missing(b);
        const sign = down ? -1 : 1;
        return sign * (typeof a === "number" && typeof b === "number"
          ? a - b : String(a).localeCompare(String(b), "en", {numeric: true}));
      };
      const body = table.tBodies[0];
      const rows = [...body.rows].map(row => [key(row), row]);
      rows.sort((a, b) => order(a[0], b[0]));
      body.append(...rows.map(pair => pair[1]));
      for (const other of headings) other.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    });
  });
}
