// For the keyboard: what scrolls is reached, what does not is passed, and the icons of hidden sidebars are buttons.
addEventListener("load", () => {
  const sizes = new ResizeObserver((entries) => {
    for (const { target } of entries) {
      if (target.scrollWidth > target.clientWidth) target.tabIndex = 0;
      else target.removeAttribute("tabindex");
    }
  });
  for (const each of document.querySelectorAll("pre, .table-wrapper")) sizes.observe(each);

  for (const label of document.querySelectorAll(".nav-overlay-icon, .toc-overlay-icon")) {
    const [icon, sidebar] = [label.firstElementChild, label.control];
    const show = () => icon.setAttribute("aria-expanded", sidebar.checked);
    icon.setAttribute("role", "button");
    icon.setAttribute("aria-label", label.matches(".nav-overlay-icon") ? "Pages" : "This page");
    icon.tabIndex = 0;
    icon.addEventListener("click", (event) => {
      event.preventDefault(); // browsers differ in whether a label counts a click on a button in it
      sidebar.click();
    });
    icon.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      icon.click();
    });
    sidebar.addEventListener("change", show);
    show();
  }
});
