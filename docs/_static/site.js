// Tables and code that are wider than a telephone scroll within themselves; a keyboard must reach them.
const wide = () => {
  for (const box of document.querySelectorAll(".table-wrapper, .highlight pre")) {
    if (box.scrollWidth > box.clientWidth) box.setAttribute("tabindex", "0");
    else box.removeAttribute("tabindex");
  }
};
addEventListener("load", wide);
addEventListener("resize", wide);

// The theme has two such landmarks on a page, without names.
document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "All pages");
document.querySelector(".toc-drawer")?.setAttribute("aria-label", "This page");

// The gallery hides the text of links that its thumbnails have.
for (const link of document.querySelectorAll(".sphx-glr-thumbcontainer a")) {
  link.setAttribute("aria-label", link.textContent);
}
