"use strict";

// Sections of a long report are folded; without a script each is opened by itself, and paper shows all by style alone.
{
  const folds = [...document.querySelectorAll("details")];
  const all = document.getElementById("unfold");
  const label = () => {
    const open = folds.every(fold => fold.open);
    all.setAttribute("aria-pressed", open);
    all.textContent = open ? "Close all sections" : "Open all sections";
  };
  const open = fold => { if (fold) fold.open = true; };
  if (all) {
    all.hidden = false;
    all.addEventListener("click", () => {
      const opened = !folds.every(fold => fold.open);
      for (const fold of folds) fold.open = opened;
    });
    for (const fold of folds) fold.addEventListener("toggle", label);
  }
  // Who asks for a section wants to see it.
  const asked = () => location.hash && open(document.querySelector(`${location.hash} details`));
  addEventListener("hashchange", asked);
  asked();
  // Browsers whose style cannot open them.
  let before = [];
  addEventListener("beforeprint", () => { before = folds.filter(fold => !fold.open); before.forEach(open); });
  addEventListener("afterprint", () => { for (const fold of before) fold.open = false; });
}
