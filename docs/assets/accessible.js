// What the theme leaves out for readers who use a keyboard or have pages read to them; `nox -s accessibility` checks it.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  for (const wide of document.querySelectorAll(".md-typeset__scrollwrap")) wide.tabIndex = 0; // tables scroll sideways
  for (const list of document.querySelectorAll("nav[aria-labelledby]")) {
    const label = document.getElementById(list.getAttribute("aria-labelledby"));
    if (label?.textContent.trim()) continue; // a section that is a page: its label is an arrow
    list.removeAttribute("aria-labelledby");
    list.setAttribute("aria-label", list.querySelector(".md-nav__title").textContent.trim());
  }
});
