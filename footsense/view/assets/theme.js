// Before the first picture: the theme that was chosen on this browser, else that of the system.
"use strict";
try {
  const chosen = localStorage.getItem("footsense-theme");
  if (chosen) document.documentElement.dataset.theme = chosen;
} catch { /* a browser without storage follows the system */ }
