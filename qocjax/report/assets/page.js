"use strict";
// What the page does by itself: theme, tabs, errors told where they are seen.

const page = {
  data: JSON.parse(document.getElementById("data").textContent),
  all: (selector, root = document) => [...root.querySelectorAll(selector)],
  plain: (html) => new DOMParser().parseFromString(html.replace(/<br>/g, "; "), "text/html").body.textContent,
};

page.trouble = (text) => {
  const place = document.getElementById("trouble");
  place.textContent = text;
  place.hidden = false;
};

page.theme = () => {
  const button = document.getElementById("theme"), root = document.documentElement;
  const kept = { get: () => null, set: () => {} };
  try {
    const store = window.localStorage;
    kept.get = () => store.getItem("qocjax-theme");
    kept.set = (value) => store.setItem("qocjax-theme", value);
  } catch { /* a browser that keeps nothing for files */ }
  const show = (theme) => {
    if (theme === "system") delete root.dataset.theme; else root.dataset.theme = theme;
    button.querySelector(".text").textContent = `Theme: ${theme}`;
  };
  const themes = ["system", "dark", "light"];
  let now = themes.includes(kept.get()) ? kept.get() : "system";
  show(now);
  button.hidden = false;
  button.addEventListener("click", () => {
    now = themes[(themes.indexOf(now) + 1) % themes.length];
    kept.set(now);
    show(now);
  });
};

page.tabs = (list, shown) => {
  const tabs = page.all("[role=tab]", list);
  const choose = (tab) => {
    for (const each of tabs) {
      const on = each === tab;
      each.setAttribute("aria-selected", String(on));
      each.tabIndex = on ? 0 : -1;
      document.getElementById(each.getAttribute("aria-controls")).classList.toggle("shown", on);
    }
    shown(document.getElementById(tab.getAttribute("aria-controls")));
  };
  const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
  tabs.forEach((tab, k) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const last = tabs.length - 1;
      const to = event.key in steps ? (k + steps[event.key] + tabs.length) % tabs.length
        : event.key === "Home" ? 0 : event.key === "End" ? last : null;
      if (to === null) return;
      event.preventDefault();
      tabs[to].focus();
      choose(tabs[to]);
    });
  });
};

page.theme();
