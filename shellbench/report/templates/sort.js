/* Tables sort by a click or the keyboard on a heading: up, down, and back to the order of the report. */
(function () {
  "use strict";

  const UNITS = { B: 1, kB: 1e3, MB: 1e6, GB: 1e9 };
  const NUMBER = /^([+-]?\d+(?:\.\d+)?)(?:\(\d+\))?(?:×10([+-]?\d+))?(?:e([+-]?\d+))?\s*([a-zA-Z%²]*)/;
  const NEXT = { none: "ascending", ascending: "descending", descending: "none" };
  const ARROWS = { none: "", ascending: " ▲", descending: " ▼" };

  /* The number a cell shows; NaN if it shows none. */
  function numberIn(text) {
    const found = NUMBER.exec(text.replaceAll("−", "-").replaceAll("\u202f", " "));
    return found ? Number(found[1]) * 10 ** Number(found[2] || found[3] || 0) * (UNITS[found[4]] || 1) : NaN;
  }

  function keyOf(cell) {
    const text = cell ? cell.textContent.trim() : "";
    const value = cell && cell.dataset.value !== undefined ? Number(cell.dataset.value) : numberIn(text);
    return { value, text };
  }

  /* Numbers before words, both before cells that show nothing; the latter stay last whichever way it is sorted. */
  function compare(a, b, sign) {
    const rank = ({ value, text }) => (text === "" || text === "–" ? 2 : Number.isNaN(value) ? 1 : 0);
    if (rank(a) !== rank(b)) {
      return rank(a) - rank(b);
    }
    return sign * (rank(a) === 0 ? a.value - b.value : a.text.localeCompare(b.text));
  }

  function sortBlock(body, column, direction) {
    const rows = [...body.rows].filter((row) => !row.classList.contains("block"));
    rows.forEach((row, place) => (row.dataset.place = row.dataset.place ?? place));
    const sign = direction === "descending" ? -1 : 1;
    const inOrder = (a, b) => Number(a.dataset.place) - Number(b.dataset.place);
    const byCell = (a, b) => compare(keyOf(a.cells[column]), keyOf(b.cells[column]), sign) || inOrder(a, b);
    body.append(...rows.sort(direction === "none" ? inOrder : byCell));
  }

  function sortBy(table, headings, column) {
    const direction = NEXT[headings[column].getAttribute("aria-sort") || "none"];
    headings.forEach((heading, i) => {
      const state = i === column ? direction : "none";
      heading.setAttribute("aria-sort", state);
      heading.querySelector(".arrow").textContent = ARROWS[state];
    });
    [...table.tBodies].forEach((body) => sortBlock(body, column, direction));
  }

  function makeSortable(table) {
    const headings = [...table.tHead.rows[0].cells];
    headings.forEach((heading, column) => {
      const pressed = document.createElement("button");
      pressed.type = "button";
      pressed.className = "sort";
      pressed.append(...heading.childNodes);
      const arrow = document.createElement("span");
      arrow.className = "arrow";
      arrow.setAttribute("aria-hidden", "true");
      pressed.append(arrow);
      pressed.addEventListener("click", () => sortBy(table, headings, column));
      heading.append(pressed);
      heading.setAttribute("aria-sort", "none");
    });
  }

  /* A link to what is folded opens it; paper shows all. */
  function unfold() {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let fold = target && (target.querySelector(":scope > details") || target.closest("details")); fold; ) {
      fold.open = true;
      fold = fold.parentElement.closest("details");
    }
    if (target) {
      target.scrollIntoView();
    }
  }

  window.addEventListener("hashchange", unfold);
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("section > details").forEach((fold) => (fold.open = true));
  });

  document.addEventListener("DOMContentLoaded", () => {
    unfold();
    [...document.querySelectorAll("table")].filter((table) => table.tHead).forEach(makeSortable);
  });
})();
