// What the theme leaves out for readers who use a keyboard or have pages read to them; `nox -s accessibility` checks it.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  for (const wide of document.querySelectorAll(".md-typeset__scrollwrap")) wide.tabIndex = 0; // tables scroll sideways
});
