for (const head of document.querySelectorAll("table.sortable thead button")) {
  head.addEventListener("click", () => {
    const cell = head.closest("th"), body = head.closest("table").tBodies[0], at = cell.cellIndex;
    const down = cell.getAttribute("aria-sort") !== "descending";
    for (const other of cell.parentNode.cells) other.removeAttribute("aria-sort");
    cell.setAttribute("aria-sort", down ? "descending" : "ascending");
    const value = row => { const v = row.cells[at].dataset.value ?? row.cells[at].textContent; return isNaN(v) ? v : Number(v); };
    const order = (a, b) => { const x = value(a), y = value(b); return x < y ? -1 : x > y ? 1 : 0; };
    body.append(...[...body.rows].sort((a, b) => down ? order(b, a) : order(a, b)));
  });
}
