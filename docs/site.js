// Lets the keyboard reach wide tables, which the theme puts into frames that scroll.
new MutationObserver(() => {
  for (const frame of document.querySelectorAll(".md-typeset__scrollwrap:not([tabindex])")) frame.tabIndex = 0;
}).observe(document.documentElement, {childList: true, subtree: true});
