"use strict";
// A click on a heading sorts its column; a second one turns the order round. Cells without a number stay last.
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  [...table.tHead.rows[0].cells].forEach((heading, column) => {
    // no <button>: browsers leave those out of the headings that they repeat on every printed page
    const button = document.createElement("span");
    button.setAttribute("role", "button");
    button.tabIndex = 0;
    button.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      button.click();
    });
    button.textContent = heading.textContent;
    heading.replaceChildren(button);
    button.addEventListener("click", () => {
      const up = heading.getAttribute("aria-sort") !== "ascending";
      for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
      heading.setAttribute("aria-sort", up ? "ascending" : "descending");
      const key = (row) => row.cells[column].dataset.value;
      const missing = (row) => key(row) === "nan";
      const compare = (a, b) => {
        if (key(a) === undefined || key(b) === undefined)
          return row(a, column).localeCompare(row(b, column), undefined, { numeric: true });
        return Number(key(a)) - Number(key(b));
      };
      const row = (one, at) => one.cells[at].textContent.trim();
      const rows = [...body.rows].sort((a, b) =>
        missing(a) || missing(b) ? missing(a) - missing(b) : up ? compare(a, b) : compare(b, a));
      body.append(...rows);
    });
  });
}
